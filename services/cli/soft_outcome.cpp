#include "cli/soft_outcome.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

#include "cli/outcome.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

// Directions that are spread evenly over a hemisphere (Fibonacci's lattice): about 12 degrees from one to the next.
constexpr std::size_t kDirections = 150;

const std::array<Vector3, kDirections>& directions() {
  static const std::array<Vector3, kDirections> all = [] {
    std::array<Vector3, kDirections> made;
    for (std::size_t i = 0; i < kDirections; ++i) {
      const double height = (static_cast<double>(i) + 0.5) / kDirections, across = std::sqrt(1 - height * height);
      const double angle = static_cast<double>(i) * std::numbers::pi * (3 - std::sqrt(5.0));
      made[i] = {across * std::cos(angle), height, across * std::sin(angle)};
    }
    return made;
  }();
  return all;
}

}  // namespace

SoftOutcome::SoftOutcome(const SoftBody& body)
    : nodes_(static_cast<std::uint32_t>(body.nodes.size())), surface_(boundary(body.tetrahedra)) {}

void SoftOutcome::on_state(const SoftObjectState& state) {
  if (state.object != kFirstSoftObject) return;
  const bool is_finite =
      std::all_of(state.nodes.begin(), state.nodes.end(), [](const auto& node) { return to_vector(node).allFinite(); });
  if (state.nodes.size() != nodes_ || !is_finite) {
    ++refused_;
    return;
  }
  // By direction: where the line through the centre leaves the object, forwards and backwards, m.
  std::array<double, kDirections> forwards{}, backwards{};
  for (const auto& triangle : surface_) {
    const auto corner = [&](std::size_t k) { return to_vector(state.nodes[static_cast<std::size_t>(triangle[k])]); };
    const Vector3 a = corner(0), b = corner(1), c = corner(2);
    // The line along d meets the triangle if d is on the same side of the planes through the centre and each edge.
    const Vector3 ab = a.cross(b), bc = b.cross(c), ca = c.cross(a);
    const double volume = a.dot(bc);
    for (std::size_t i = 0; i < kDirections; ++i) {
      const Vector3& d = directions()[i];
      const double x = bc.dot(d), y = ca.dot(d), z = ab.dot(d);
      const bool meets = (x >= 0 && y >= 0 && z >= 0) || (x <= 0 && y <= 0 && z <= 0);
      if (!meets || x + y + z == 0) continue;
      const double place = volume / (x + y + z);
      forwards[i] = std::max(forwards[i], place);
      backwards[i] = std::max(backwards[i], -place);
    }
  }
  Sample sample{state.stamp.sample_time, to_vector(state.centre).y(), std::numeric_limits<double>::infinity(), 0,
                state.contact_count,     state.inverted_elements > 0};
  for (std::size_t i = 0; i < kDirections; ++i) {
    if (forwards[i] == 0 || backwards[i] == 0) continue;
    sample.least_width = std::min(sample.least_width, forwards[i] + backwards[i]);
    sample.greatest_width = std::max(sample.greatest_width, forwards[i] + backwards[i]);
  }
  if (sample.greatest_width > 0) samples_.push_back(sample);
}

void SoftOutcome::on_contacts(const Contacts& contacts) {
  Force force{contacts.stamp.sample_time};
  for (const Contact& each : contacts.contacts)
    if (each.object == kFirstSoftObject && all_finite(each.force))
      force.point = std::max(force.point, to_vector(each.force).norm());
  for (const FingerContact& each : contacts.fingers)
    if (each.object == kFirstSoftObject && all_finite(each.force))
      force.finger = std::max(force.finger, to_vector(each.force).norm());
  if (force.point > 0) forces_.push_back(force);
}

nlohmann::ordered_json SoftOutcome::summary(const SoftGoal& goal, const OutcomeFrame& frame) const {
  nlohmann::ordered_json json;
  Nanoseconds end = std::numeric_limits<Nanoseconds>::max();
  if (!frame.phases.empty()) end = frame.motion_start + static_cast<Nanoseconds>(1e9 * (frame.phases.back().end + 0.5));
  json["refused_states"] = refused_;
  if (samples_.empty() || samples_.front().time > end) {
    if (goal.any()) {
      json["success"] = false;
      json["success_because"] = "no message about the flexible object arrived";
    }
    return json;
  }
  const auto begin_of = [&](const char* name, Nanoseconds otherwise) {
    for (const MotionPhase& phase : frame.phases)
      if (phase.name == name) return frame.motion_start + static_cast<Nanoseconds>(1e9 * phase.begin);
    return otherwise;
  };
  const Nanoseconds squeeze = begin_of("squeeze", end), lift = begin_of("lift", end), lower = begin_of("lower", end);
  const Sample& first = samples_.front();
  Sample last = first;
  double least = first.least_width, kept = first.least_width, highest = first.height;
  std::uint32_t most_contacts = 0;
  std::uint64_t inverted_steps = 0;
  for (const Sample& each : samples_) {
    if (each.time > end) break;
    least = std::min(least, each.least_width);
    if (each.time <= squeeze) kept = least;
    highest = std::max(highest, each.height);
    most_contacts = std::max(most_contacts, each.contacts);
    inverted_steps += each.inverted ? 1 : 0;
    last = each;
  }
  double point = 0, finger = 0, held = 0, held_count = 0;
  for (const Force& each : forces_) {
    if (each.time > end) break;
    point = std::max(point, each.point);
    finger = std::max(finger, each.finger);
    if (each.time < lift || each.time >= lower) continue;
    held += each.finger;
    ++held_count;
  }
  const double squeezed = least / first.least_width, lifted = highest - first.height;
  const double off = std::max(std::abs(last.least_width / first.least_width - 1),
                              std::abs(last.greatest_width / first.greatest_width - 1));
  json["least_width_first_mm"] = first.least_width * 1e3;
  json["least_width_mm"] = least * 1e3;
  json["kept_fraction"] = kept / first.least_width;
  json["squeezed_to_fraction"] = squeezed;
  json["end_off_fraction"] = off;
  json["lifted_mm"] = lifted * 1e3;
  json["contacts_max"] = most_contacts;
  json["point_force_max_n"] = point;
  json["finger_force_max_n"] = finger;
  json["held_force_n"] = held_count > 0 ? nlohmann::ordered_json(held / held_count) : nullptr;
  json["inverted_steps"] = inverted_steps;
  if (!goal.any()) return json;
  bool success = true;
  std::string because;
  const auto judge = [&](bool meets, const std::string& text) {
    success = success && meets;
    because += (because.empty() ? "" : "; ") + text;
  };
  if (goal.lifted > 0) {
    judge(lifted >= goal.lifted,
          fmt::format("the object was lifted by {:.1f} mm (asked: {:.1f} mm)", 1e3 * lifted, 1e3 * goal.lifted));
  }
  if (goal.kept > 0) {
    judge(kept >= goal.kept * first.least_width,
          fmt::format("it kept {:.1f} % of its width until the squeeze (asked: {:.1f} %), held with {:.2f} N",
                      100 * kept / first.least_width, 100 * goal.kept, held_count > 0 ? held / held_count : 0));
  }
  if (goal.squeezed > 0) {
    judge(squeezed <= goal.squeezed,
          fmt::format("the object was squeezed to {:.1f} % of its width (asked: {:.1f} %), with up to {:.2f} N",
                      100 * squeezed, 100 * goal.squeezed, finger));
  }
  if (goal.recovers > 0) {
    judge(off <= goal.recovers && last.contacts == 0,
          fmt::format("its widths at the end differ by {:.2f} % from the first ones (allowed: {:.1f} %); {}", 100 * off,
                      100 * goal.recovers, last.contacts > 0 ? "the hand still touched it" : "the hand let go of it"));
  }
  json["success"] = success;
  json["success_because"] = because;
  return json;
}

}  // namespace softhand
