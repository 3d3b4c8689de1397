#include "cli/soft_outcome.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

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

SoftOutcome::Widths SoftOutcome::widths_of(const SoftObjects& soft, const State& state) {
  Vector3 centre = Vector3::Zero();
  for (int n = soft.first_node(0); n < soft.first_node(1); ++n)
    centre += soft.node_masses()[static_cast<std::size_t>(n)] * state.node_positions.col(n);
  centre /= soft.mass(0);
  // By direction: where the line through the centre leaves the object, forwards and backwards, m.
  std::array<double, kDirections> forwards{}, backwards{};
  for (const auto& triangle : soft.surface(0)) {
    const auto corner = [&](std::size_t k) { return Vector3(state.node_positions.col(triangle[k]) - centre); };
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
  Widths widths{std::numeric_limits<double>::infinity(), 0};
  for (std::size_t i = 0; i < kDirections; ++i) {
    widths.least = std::min(widths.least, forwards[i] + backwards[i]);
    widths.greatest = std::max(widths.greatest, forwards[i] + backwards[i]);
  }
  return widths;
}

void SoftOutcome::add(const HandSimulation& simulation) {
  const SoftObjects* soft = simulation.soft();
  if (soft == nullptr) return;
  last_ = widths_of(*soft, simulation.state());
  if (!is_on_) {
    first_ = last_;
    least_ = last_.least;
  }
  is_on_ = true;
  least_ = std::min(least_, last_.least);
  for (const SkinAnchor& anchor : soft->skin().anchors()) strongest_ = std::max(strongest_, anchor.force.norm());
  most_contacts_ = std::max(most_contacts_, soft->skin().anchors().size());
  touched_at_end_ = !soft->skin().anchors().empty();
  if (soft->tissue().inverted_elements(simulation.state()) > 0) ++inverted_steps_;
}

nlohmann::ordered_json SoftOutcome::summary(const SoftGoal& goal) const {
  nlohmann::ordered_json json;
  if (!is_on_) return json;
  const double squeezed = least_ / first_.least;
  const double off = std::max(std::abs(last_.least / first_.least - 1), std::abs(last_.greatest / first_.greatest - 1));
  json["least_width_first_mm"] = first_.least * 1e3;
  json["least_width_mm"] = least_ * 1e3;
  json["squeezed_to_fraction"] = squeezed;
  json["end_off_fraction"] = off;
  json["contacts_max"] = most_contacts_;
  json["point_force_max_n"] = strongest_;
  json["inverted_steps"] = inverted_steps_;
  if (!goal.any()) return json;
  bool success = true;
  std::string because;
  if (goal.squeezed > 0) {
    success = squeezed <= goal.squeezed;
    because = fmt::format("the object was squeezed to {:.1f} % of its width (asked: {:.1f} %)", 100 * squeezed,
                          100 * goal.squeezed);
  }
  if (goal.recovers > 0) {
    success = success && off <= goal.recovers && !touched_at_end_;
    because += fmt::format("{}its widths at the end differ by {:.2f} % from the first ones (allowed: {:.1f} %){}",
                           because.empty() ? "" : "; ", 100 * off, 100 * goal.recovers,
                           touched_at_end_ ? "; the hand still touched it" : "; the hand let go of it");
  }
  json["success"] = success;
  json["success_because"] = because;
  return json;
}

}  // namespace softhand
