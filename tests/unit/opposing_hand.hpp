// A block hand that can grip, and a motion of it.
#pragma once

#include <array>
#include <memory>

#include "math/rotation.hpp"
#include "support/block_hand.hpp"
#include "trackers/replay/generator.hpp"

namespace softhand::testing {

/// The block hand with an opposing thumb. The thumb is rolled about its bone so that its pad faces the fingers.
inline HandModel opposing_hand() {
  HandModel hand = block_hand();
  const Quaternion turn = Quaternion(Eigen::AngleAxisd(0.8, Vector3::UnitY())) *
                          Quaternion(Eigen::AngleAxisd(-0.5, Vector3::UnitX())) *
                          Quaternion(Eigen::AngleAxisd(1.2, Vector3::UnitZ()));
  const std::array<double, 4> depth{0, 0.046, 0.080, 0.106};
  for (std::size_t k = 0; k < 4; ++k) {
    hand.rest_joints[2 + k] = {Vector3(-0.022, -0.005, -0.022) + turn * Vector3(0, 0, -depth[k]), turn};
  }
  hand.joint_radii.fill(0.008);
  hand.bodies[slot_of(Body::thumb_metacarpal)].joint.flexion_range = {-0.9, 0.5};
  hand.bodies[slot_of(Body::thumb_metacarpal)].joint.abduction_range = {-0.7, 0.7};
  hand.bodies[slot_of(Body::index_proximal)].joint.abduction_range = {-0.35, 0.35};
  return hand;
}

inline Vector3 pad(const HandModel& hand, Finger finger, const JointFrames& frames) {
  return frames[slot_of(joint_of(distal_of(finger)))] * pad_in_distal(hand, finger);
}

inline std::shared_ptr<const Motion> free_motion() {
  GeneratorOptions options;
  options.motion = "free_motion";
  static const std::shared_ptr<const Motion> motion = make_motion(opposing_hand(), options);
  return motion;
}

}  // namespace softhand::testing
