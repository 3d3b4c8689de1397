#include "device/grounded_point.hpp"

#include <algorithm>
#include <stdexcept>

#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr std::string_view kWholeHand = "hand";

std::optional<Body> bone_of(const std::string& name) {
  const auto at = std::find(kBodyNames.begin(), kBodyNames.end(), name);
  if (at == kBodyNames.end()) return std::nullopt;
  return static_cast<Body>(at - kBodyNames.begin());
}

}  // namespace

void describe(OptionVisitor& v, GroundedPointOptions& o) {
  std::vector<std::string_view> names(kBodyNames.begin(), kBodyNames.end());
  names.push_back(kWholeHand);
  v.choice("holds", o.holds, std::move(names),
           "What the cursor holds. A bone: its far end, and the forces on this bone. The hand: its palm, and the "
           "forces on all bones.");
  v.numbers("base_position", o.base_position.data(), 3, "m", {-1000, 1000}, "Origin of the device in the world.");
  v.numbers(
      "base_orientation", o.base_orientation.data(), 4, "1", {-1, 1},
      "Orientation of the device in the world, quaternion xyzw. With the default the world's X is right, Y up and "
      "Z to the user.");
  v.number("scale", o.scale, "1", {0.1, 20},
           "Motion of the hand by motion of the cursor. Forces are multiplied by it too, so that no work is lost. "
           "`gain` lowers them.");
  v.number("maximum_force", o.maximum_force, "N", {0.1, 40}, "Largest force of the device along each axis.");
  v.number("slew", o.slew, "N/s", {1, 100000}, "Largest rate of change of a force.");
  v.number("stiffness", o.stiffness, "N/m", {0, 20000},
           "Largest stiffness that the device renders stably. 0: no local model, forces of messages are held.");
  v.number("damping", o.damping, "N s/m", {0, 200}, "Largest damping that the device renders stably.");
}

GroundedPoint::GroundedPoint(const GroundedPointOptions& options, const HandModel& hand)
    : options_(options),
      bone_(bone_of(options.holds)),
      held_(bone_ ? end_joint_of(*bone_) : Joint::palm),
      orientation_(to_quaternion(options.base_orientation)),
      lifter_(hand, hand.side) {
  if (!(orientation_.norm() > 0.1)) throw std::invalid_argument("base_orientation: expected a quaternion, not zero");
  orientation_.normalize();
}

DeviceLimits GroundedPoint::limits() const {
  return {3, -options_.maximum_force, options_.maximum_force, options_.slew, options_.stiffness, options_.damping};
}

void GroundedPoint::command(const BoneWrench& input, std::span<double> requested) const {
  Vector3 force = Vector3::Zero();
  for (std::size_t b = 0; b < kBodyCount; ++b)
    if (!bone_ || static_cast<Body>(b) == *bone_) force += to_vector(input.bones[b].coupling_force);
  Eigen::Map<Vector3>(requested.data()) = options_.scale * (orientation_.conjugate() * force);
}

void GroundedPoint::lift(const Vector3& cursor, Skeleton& out) const {
  std::array<FingerCurl, kFingerCount> open;
  for (FingerCurl& finger : open) finger.valid = true;
  lifter_.lift(open, out);
  const auto held = static_cast<std::size_t>(held_);
  const Vector3 place = to_vector(options_.base_position) + options_.scale * (orientation_ * cursor) -
                        to_vector(out.joints[held].position);
  for (JointSample& joint : out.joints) {
    joint.position = to_wire(Vector3(to_vector(joint.position) + place));
    joint.flags = kJointValid | kJointInferred;
  }
  out.joints[held].flags = kJointValid | kJointTracked;
  out.frame = 0;
  out.confidence = 1;
}

}  // namespace softhand
