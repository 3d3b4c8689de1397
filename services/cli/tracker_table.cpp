#include "cli/tracker_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "messages/age.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kLongestTime = 9e9;  // s; more does not fit in nanoseconds
constexpr double kSilent = 1;         // s without a status: the process is gone

// Any process may publish a status, with any number. False for one that is not finite.
bool is_in(double value, double low, double high) { return value >= low && value <= high; }

bool is_alive(const TrackerRow& row, Nanoseconds now) {
  const auto silent = age_of(row.heard, now);
  return silent && *silent <= kSilent;
}

}  // namespace

std::optional<Nanoseconds> motion_start_of(const LoopStatus& status) {
  const auto seconds = find_counter(status, "motion_start_s");
  if (!seconds || !is_in(*seconds, -kLongestTime, kLongestTime)) return std::nullopt;
  return static_cast<Nanoseconds>(*seconds * 1e9);
}

void TrackerTable::add(const LoopStatus& status, Nanoseconds now) {
  const auto strength = find_counter(status, "strength"), published = find_counter(status, "published");
  const auto health = find_counter(status, "health");
  if (!strength || !published || !health) return;
  const double user = find_counter(status, "user").value_or(0),
               confidence = find_counter(status, "confidence").value_or(0);
  const bool is_plausible = is_in(*strength, 0, strength_of(kMostStrength, Health::live)) &&
                            is_in(user, 0, std::numeric_limits<std::uint32_t>::max()) && std::isfinite(*published) &&
                            std::isfinite(*health) && std::isfinite(confidence);
  if (!is_plausible) return;
  TrackerRow* const known = table_.of(get_text(status.module), now);
  if (known == nullptr) return;
  TrackerRow& row = *known;
  if (row.epoch != status.stamp.epoch) row = {};
  row.heard = status.stamp.publish_time;
  const double elapsed = static_cast<double>(row.heard - row.counted) * 1e-9;
  if (row.counted == 0 || elapsed > 0.9) {
    if (row.counted != 0) row.rate_hz = (*published - row.published) / elapsed;
    row.published = *published;
    row.counted = row.heard;
  }
  row.epoch = status.stamp.epoch;
  row.user = static_cast<std::uint32_t>(user);
  row.strength = static_cast<int>(*strength);
  row.health = static_cast<Health>(std::clamp(*health, 0.0, static_cast<double>(kHealthNames.size() - 1)));
  row.age_ms = status.input_age_ms;
  row.confidence = confidence;
}

void TrackerTable::add(const Skeleton& hand) {
  if (hand.hand.side > 1) return;
  for (auto& [name, row] : table_.rows()) {
    // A played motion that starts over counts its epoch up.
    if (row.user == hand.hand.user) row.owns[hand.hand.side] = hand.stamp.epoch - row.epoch < 1'000'000;
  }
}

bool TrackerTable::owns(const std::string& module) const {
  const auto found = trackers().find(module);
  return found != trackers().end() && (found->second.owns[0] || found->second.owns[1]);
}

std::string TrackerTable::hands_of(const std::string& module) const {
  const auto found = trackers().find(module);
  if (found == trackers().end() || !owns(module)) return "no hand";
  const auto& [left, right] = found->second.owns;
  return fmt::format("{} of user {}",
                     left && right ? "both hands"
                     : left        ? "the left hand"
                                   : "the right hand",
                     found->second.user);
}

std::optional<int> TrackerTable::strength_to_own(const std::string& module, Nanoseconds now) const {
  const auto own = trackers().find(module);
  if (own == trackers().end() || !is_alive(own->second, now)) return std::nullopt;
  int strength = own->second.strength;
  for (const auto& [name, row] : trackers())
    if (name != module && row.user == own->second.user && is_alive(row, now))
      strength = std::max(strength, row.strength + 1);
  return strength;
}

std::string TrackerTable::text(Nanoseconds now) const {
  if (trackers().empty()) return "no tracker found on this domain\n";
  std::string out = fmt::format("{:<18} {:>4} {:>8} {:<8} {:>8} {:>8} {:>10}  {}\n", "module", "user", "strength",
                                "health", "rate Hz", "age ms", "confidence", "owns");
  for (const auto& [name, row] : trackers()) {
    out += fmt::format("{:<18} {:>4} {:>8} {:<8} {:>8.1f} {:>8} {:>10.2f}  {}\n", name, row.user, row.strength,
                       is_alive(row, now) ? kHealthNames[static_cast<std::size_t>(row.health)] : "gone", row.rate_hz,
                       row.age_ms < 0 ? "-" : fmt::format("{:.1f}", row.age_ms), row.confidence,
                       owns(name) ? hands_of(name) : "-");
  }
  return out;
}

}  // namespace softhand
