#include "device/curl_lifter.hpp"

#include <algorithm>

#include "messages/convert.hpp"

namespace softhand {

CurlLifter::CurlLifter(const HandModel& hand, Side side)
    : hand_(hand.side == side ? hand : mirrored(hand)), open_(open_hand(hand_)) {}

void CurlLifter::lift(const std::array<FingerCurl, kFingerCount>& fingers, Skeleton& out) const {
  // A finger turns about +Y towards -X, where the thumb of a right hand is.
  const double to_thumb = hand_.side == Side::right ? 1 : -1;
  JointAngles angles = open_;
  for (std::size_t f = 0; f < fingers.size(); ++f) {
    if (!fingers[f].valid) continue;
    const auto first = static_cast<std::size_t>(index_of(distal_of(static_cast<Finger>(f)))) - 2;
    for (std::size_t k = 0; k < 3; ++k) {
      const double curl = std::clamp(fingers[f].curl[k], 0.0, 1.0), open = open_[first + k].x();
      angles[first + k].x() = open + curl * (hand_.bodies[first + k].joint.flexion_range[0] - open);
    }
    const auto& range = hand_.bodies[first].joint.abduction_range;
    angles[first].y() = std::clamp(to_thumb * fingers[f].splay, range[0], range[1]);
  }
  const JointFrames joints = forward_kinematics(hand_, Pose{}, angles);
  out.hand.side = static_cast<std::uint32_t>(hand_.side);
  out.frame = 2;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Body body = body_of(static_cast<Joint>(j));
    const Finger finger = finger_of(body);
    const bool is_measured = finger != Finger::palm && (finger == Finger::thumb || !is_metacarpal(body));
    const bool is_valid = finger == Finger::palm || fingers[static_cast<std::size_t>(finger)].valid;
    JointSample& joint = out.joints[j];
    joint.position = to_wire(joints[j].position);
    joint.orientation = to_wire(joints[j].orientation);
    joint.radius = hand_.joint_radii[j];
    joint.flags = !is_valid ? 0 : kJointValid | (is_measured ? kJointTracked : kJointInferred);
  }
}

}  // namespace softhand
