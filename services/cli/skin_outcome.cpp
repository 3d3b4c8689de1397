#include "cli/skin_outcome.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "cli/outcome.hpp"
#include "energies/skin_contact.hpp"
#include "scene/finger_gap.hpp"

namespace softhand {

void SkinOutcome::add(const HandSimulation& simulation) {
  ++steps_;
  gap_ = std::min(gap_, finger_gap(simulation.hand(), simulation.state()));
  const SkinContact* skin = simulation.skin();
  if (skin == nullptr) return;
  is_on_ = true;
  heat_ = skin->dissipated();
  std::size_t count = 0;
  for (const SkinAnchor& anchor : skin->anchors()) {
    const AnchorOffset offset = skin->offset(anchor, simulation.state());
    if (!(offset.depth < 0) || anchor.recess > 0) continue;  // a point that started inside is on its way out
    ++count;
    depths_.push_back(-offset.depth);
    deepest_ = std::max(deepest_, -offset.depth);
    if (!anchor.sliding) continue;
    const double push = offset.normal.dot(anchor.force);
    sliding_push_ += push;
    sliding_drag_ += (anchor.force - push * offset.normal).norm();
  }
  most_contacts_ = std::max(most_contacts_, count);
  if (count > 0) ++touching_steps_;
}

nlohmann::ordered_json SkinOutcome::summary(const SkinGoal& goal, double friction) const {
  nlohmann::ordered_json json;
  json["finger_bones_gap_min_mm"] = gap_ * 1e3;
  if (!is_on_) return json;
  const double penetration = depths_.empty() ? 0.0 : percentile(depths_, 0.95);
  const double ratio = sliding_push_ > 0 ? sliding_drag_ / sliding_push_ : std::nan("");
  json["contacts_max"] = most_contacts_;
  json["touching_steps_fraction"] = static_cast<double>(touching_steps_) / static_cast<double>(std::max(steps_, 1ul));
  json["penetration_p95_mm"] = penetration * 1e3;
  json["penetration_max_mm"] = deepest_ * 1e3;
  json["sliding_friction_ratio"] =
      std::isfinite(ratio) ? nlohmann::ordered_json(ratio) : nlohmann::ordered_json(nullptr);
  json["heat_j"] = heat_;
  if (!goal.any()) return json;
  bool success = touching_steps_ > 0;
  std::string because = success ? "" : "the skin did not touch itself; ";
  const auto state = [&](bool holds, const std::string& text) {
    success = success && holds;
    because += text;
  };
  if (goal.penetration > 0) {
    state(penetration <= goal.penetration,
          fmt::format("95 % of the touching points are at most {:.2f} mm deep (allowed: "
                      "{:.2f} mm); ",
                      penetration * 1e3, goal.penetration * 1e3));
    state(gap_ > 0, fmt::format("the bones of two fingers are at least {:.2f} mm apart; ", gap_ * 1e3));
  }
  if (goal.friction > 0) {
    state(std::abs(ratio - friction) <= goal.friction * friction,
          fmt::format("friction of sliding skin is {:.4f} of the normal force (asked: {:.4f} within {:.1f} %); ", ratio,
                      friction, goal.friction * 100));
  }
  json["success"] = success;
  json["success_because"] = because.substr(0, because.size() - 2);
  return json;
}

}  // namespace softhand
