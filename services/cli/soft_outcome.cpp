#include "cli/soft_outcome.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>

namespace softhand {
namespace {

// Directions that are spread evenly over a hemisphere (Fibonacci's lattice): about 8 degrees from one to the next.
constexpr int kDirections = 300;

Vector3 direction(int i) {
  const double height = (i + 0.5) / kDirections, angle = i * std::numbers::pi * (3 - std::sqrt(5.0));
  const double across = std::sqrt(1 - height * height);
  return {across * std::cos(angle), height, across * std::sin(angle)};
}

}  // namespace

SoftOutcome::Widths SoftOutcome::widths_of(const SoftObjects& soft, const State& state) {
  const auto nodes = state.node_positions.middleCols(soft.first_node(0), soft.node_count(0));
  Widths widths{std::numeric_limits<double>::infinity(), 0};
  for (int i = 0; i < kDirections; ++i) {
    const Eigen::RowVectorXd heights = direction(i).transpose() * nodes;
    const double width = heights.maxCoeff() - heights.minCoeff();
    widths.least = std::min(widths.least, width);
    widths.greatest = std::max(widths.greatest, width);
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
