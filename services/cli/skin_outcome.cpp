#include "cli/skin_outcome.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "cli/outcome.hpp"
#include "energies/skin_contact.hpp"
#include "scene/finger_gap.hpp"
#include "scene/hand_simulation.hpp"

namespace softhand {

namespace {

int owner_of_point(const SkinContact& skin, const SkinAnchor& anchor) {
  return skin_owner(skin_part(skin.points()[anchor.point].body));
}

// A contact of a hand with itself or with another hand. Points that started inside are on their way out.
bool touches(const HandSimulation& simulation, const SkinContact& skin, const SkinAnchor& anchor) {
  return owner_of_point(skin, anchor) < kMostHands && anchor.slot < kFirstSoftPart && !(anchor.recess > 0) &&
         skin.offset(anchor, simulation.state()).depth < 0;
}

// Contact with itself of each hand, and between two hands.
template <typename Visit>
void for_each_skin(const HandSimulation& simulation, Visit&& visit) {
  for (int hand = 0; hand < simulation.hand_count(); ++hand)
    if (simulation.skin(hand) != nullptr) visit(*simulation.skin(hand));
  if (simulation.hand_count() > 1) visit(*simulation.skin_between());
}

}  // namespace

std::size_t SkinOutcome::count(const HandSimulation& simulation) {
  std::size_t count = 0;
  for_each_skin(simulation, [&](const SkinContact& skin) {
    for (const SkinAnchor& anchor : skin.anchors()) count += touches(simulation, skin, anchor) ? 1 : 0;
  });
  return count;
}

void SkinOutcome::end(const HandSimulation& simulation) { touches_at_end_ = count(simulation) > 0; }

void SkinOutcome::add(const HandSimulation& simulation) {
  ++steps_;
  const State& state = simulation.state();
  for (int hand = 0; hand < simulation.hand_count(); ++hand)
    gap_ = std::min(gap_, finger_gap(simulation.hand(hand), state, simulation.first_body(hand)));
  heat_ = 0;
  for_each_skin(simulation, [&](const SkinContact& skin) { add(simulation, skin); });
  if (simulation.hand_count() > 1) {
    has_hands_ = true;
    hands_gap_ = std::min(hands_gap_, hands_gap(simulation.hand(0), simulation.first_body(0), simulation.hand(1),
                                                simulation.first_body(1), state));
    Vector3 force = Vector3::Zero();
    const SkinContact& between = *simulation.skin_between();
    for (const SkinAnchor& anchor : between.anchors()) {
      if (touches(simulation, between, anchor)) force += (owner_of_point(between, anchor) == 0 ? 1 : -1) * anchor.force;
    }
    most_force_ = std::max(most_force_, force.norm());
  }
  const std::size_t now = count(simulation);
  most_contacts_ = std::max(most_contacts_, now);
  if (now > 0) ++touching_steps_;
}

void SkinOutcome::add(const HandSimulation& simulation, const SkinContact& skin) {
  is_on_ = true;
  heat_ += skin.dissipated();
  for (const SkinAnchor& anchor : skin.anchors()) {
    if (!touches(simulation, skin, anchor)) continue;
    const AnchorOffset offset = skin.offset(anchor, simulation.state());
    depths_.push_back(-offset.depth);
    deepest_ = std::max(deepest_, -offset.depth);
    if (!anchor.sliding) continue;
    const double push = offset.normal.dot(anchor.force);
    sliding_push_ += push;
    sliding_drag_ += (anchor.force - push * offset.normal).norm();
  }
}

nlohmann::ordered_json SkinOutcome::summary(const SkinGoal& goal, double friction) const {
  nlohmann::ordered_json json;
  json["finger_bones_gap_min_mm"] = gap_ * 1e3;
  if (has_hands_) json["hand_bones_gap_min_mm"] = hands_gap_ * 1e3;
  if (!is_on_) return json;
  if (has_hands_) json["hand_on_hand_force_max_n"] = most_force_;
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
    if (has_hands_)
      state(hands_gap_ > 0, fmt::format("the bones of the two hands are at least {:.2f} mm apart; ", hands_gap_ * 1e3));
  }
  if (goal.parts)
    state(!touches_at_end_, touches_at_end_ ? "skin touches skin at the end; " : "no skin touches skin at the end; ");
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
