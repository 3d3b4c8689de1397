#include "cli/hands_outcome.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>

#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kSettles = 0.5;  // s, at the start of the hold

}  // namespace

HandsOutcome::HandsOutcome(const OutcomeFrame& frame, double gravity, bool one_process)
    : frame_(frame), object_(frame.object), weight_(frame.object_mass * gravity), one_process_(one_process) {}

void HandsOutcome::add(Nanoseconds time, std::size_t hand, const ObjectCoupling& coupling, const Contacts& contacts,
                       const Pose& palm, const WorldObjects& objects) {
  if (hand >= held_.size()) return;
  const auto object = std::find_if(objects.objects.begin(), objects.objects.end(),
                                   [this](const ObjectState& each) { return each.object == object_; });
  if (object == objects.objects.end()) return;
  Held& held = held_[hand];
  held.force.setZero();
  for (const ObjectTwin& twin : coupling.twins) {
    if (twin.object != object_) continue;
    if (!one_process_) held.force = to_vector(twin.contact_force);
    held.in_palm = palm.inverse() * to_pose(twin.position, twin.orientation);
  }
  double upward = 0;
  Vector3 centre = Vector3::Zero();
  for (const Contact& contact : contacts.contacts) {
    if (contact.object != object_) continue;
    if (one_process_) held.force -= to_vector(contact.force);
    upward -= contact.force[1];
    centre -= contact.force[1] * to_vector(contact.point);
  }
  held.touches = held.force.norm() > 0;
  if (upward > 0) held.centre = centre / upward;
  if (object->owned != 0) {
    const std::uint64_t owner = (std::uint64_t{object->owner_user} << 32) | object->owner_side;
    if (owner_ && *owner_ != owner) ++owner_changes_;
    owner_ = owner;
  }
  if (hand != 1) return;
  if (held_[0].touches && held_[1].touches) {
    if (is_held(time)) add_both(*object);
    handed_at_ = time;
    for (std::size_t h = 0; h < 2; ++h) at_hand_over_[h] = held_[h].in_palm;
    receiver_.reset();
    handed_slip_ = handed_turn_ = handed_seconds_ = 0;
  } else if (handed_at_ && held_[0].touches != held_[1].touches) {
    const std::size_t holder = held_[0].touches ? 0 : 1;
    if (!receiver_) receiver_ = holder;
    if (*receiver_ != holder) return;
    handed_slip_ = std::max(handed_slip_, (held_[holder].in_palm.position - at_hand_over_[holder].position).norm());
    handed_turn_ =
        std::max(handed_turn_, held_[holder].in_palm.orientation.angularDistance(at_hand_over_[holder].orientation));
    handed_seconds_ = static_cast<double>(time - *handed_at_) * 1e-9;
  }
}

bool HandsOutcome::is_held(Nanoseconds time) const {
  const double seconds = static_cast<double>(time - frame_.motion_start) * 1e-9;
  return std::any_of(frame_.phases.begin(), frame_.phases.end(), [seconds](const MotionPhase& phase) {
    return phase.name == "hold" && seconds >= phase.begin + kSettles && seconds <= phase.end;
  });
}

void HandsOutcome::add_both(const ObjectState& object) {
  const double carried = held_[0].force.y() + held_[1].force.y();
  lowest_carried_ = both_steps_ == 0 ? carried : std::min(lowest_carried_, carried);
  highest_carried_ = both_steps_ == 0 ? carried : std::max(highest_carried_, carried);
  ++both_steps_;
  carried_ += carried;
  share_ += held_[0].force.y() / carried;
  // The levers lie along the horizontal line between the two hands.
  Vector3 line = held_[0].centre - held_[1].centre;
  line.y() = 0;
  lever_share_ += line.dot(to_vector(object.position) - held_[1].centre) / line.squaredNorm();
}

nlohmann::ordered_json HandsOutcome::summary(const HandsGoal& goal) const {
  nlohmann::ordered_json json;
  const double steps = std::max(1, both_steps_);
  const double ratio = carried_ / steps / weight_, share = share_ / steps, lever = lever_share_ / steps;
  json["both_hold_steps"] = both_steps_;
  const auto number = [this](double value) {
    return both_steps_ > 0 ? nlohmann::ordered_json(value) : nlohmann::ordered_json(nullptr);
  };
  json["carried_weight_ratio"] = number(ratio);
  json["carried_weight_ratio_min"] = number(lowest_carried_ / weight_);
  json["carried_weight_ratio_max"] = number(highest_carried_ / weight_);
  json["first_hand_share"] = number(share);
  json["first_hand_lever_share"] = number(lever);
  json["owner_changes"] = owner_changes_;
  json["handed_seconds"] = handed_seconds_;
  json["handed_slip_mm"] = receiver_ ? nlohmann::ordered_json(handed_slip_ * 1e3) : nlohmann::ordered_json(nullptr);
  json["handed_turn_deg"] =
      receiver_ ? nlohmann::ordered_json(handed_turn_ * 180 / M_PI) : nlohmann::ordered_json(nullptr);
  if (!goal.any()) return json;
  bool success = true;
  std::string because;
  const auto state = [&](bool holds, const std::string& text) {
    success = success && holds;
    because += (because.empty() ? "" : "; ") + text;
  };
  if (goal.weight > 0)
    state(both_steps_ > 0 && std::abs(ratio - 1) <= goal.weight,
          fmt::format("both hands carried {:.4f} of the weight in {} steps (asked: 1 within {})", ratio, both_steps_,
                      goal.weight));
  if (goal.share > 0)
    state(both_steps_ > 0 && std::abs(share - lever) <= goal.share,
          fmt::format("the first hand carried {:.3f} of it, and {:.3f} by the lever arms (asked: within {})", share,
                      lever, goal.share));
  if (goal.handed_slip > 0)
    state(receiver_ && handed_slip_ <= goal.handed_slip,
          receiver_ ? fmt::format("the object moved by {:.2f} mm in the palm of the hand that took it, in {:.1f} s "
                                  "(allowed: {:.1f} mm)",
                                  handed_slip_ * 1e3, handed_seconds_, goal.handed_slip * 1e3)
                    : std::string("no hand took the object over"));
  json["success"] = success;
  json["success_because"] = because;
  return json;
}

}  // namespace softhand
