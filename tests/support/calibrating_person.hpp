// A person who shows the postures of a calibration, one after the other.
#pragma once

#include <algorithm>
#include <array>

#include "device/hand_measurement.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "model/kinematics.hpp"
#include "trackers/replay/motion.hpp"

namespace softhand::testing {

/// The skeleton of `hand` with other bone lengths: longer fingers, a shorter thumb, a broader palm. Only the joints are
/// scaled.
inline HandModel other_lengths(const HandModel& hand) {
  constexpr std::array<double, kFingerCount> kScale{0.9, 1.08, 1.12, 1.1, 1.05};
  HandModel out = hand;
  const auto place = [&](Joint joint) {
    const auto j = static_cast<std::size_t>(index_of(joint)), p = static_cast<std::size_t>(index_of(parent_of(joint)));
    const double scale = kScale[static_cast<std::size_t>(finger_of(body_of(joint)))];
    out.rest_joints[j].position =
        out.rest_joints[p] * (scale * (hand.rest_joints[p].inverse() * hand.rest_joints[j]).position);
  };
  for (std::size_t j = 2; j < kJointCount; ++j) place(static_cast<Joint>(j));
  place(Joint::palm);
  return out;
}

inline double bone_length(const JointFrames& joints, std::size_t joint) {
  return (joints[joint].position -
          joints[static_cast<std::size_t>(index_of(parent_of(static_cast<Joint>(joint))))].position)
      .norm();
}

class CalibratingPerson final : public Motion {
 public:
  /// `step`: s, duration of a posture. A change takes its first 30 %.
  CalibratingPerson(const HandModel& hand, double step) : hand_(hand), step_(step) {
    for (std::size_t k = 0; k < kPostureCount; ++k) angles_[k] = angles_of(hand, static_cast<Posture>(k));
  }

  static JointAngles angles_of(const HandModel& hand, Posture posture) {
    JointAngles angles = open_hand(hand);
    for (int f = 0; f < kFingerCount; ++f) {
      const auto first = static_cast<std::size_t>(index_of(distal_of(static_cast<Finger>(f)))) - 2;
      const bool is_thumb = f == 0;
      for (std::size_t k = first; k < first + 3; ++k) {
        const double closed = hand.bodies[k].joint.flexion_range[0];
        double share = 0;
        if (posture == Posture::fist) share = is_thumb ? 0.4 : 0.95;
        if (posture == Posture::thumb_across) share = is_thumb ? 1 : 0.1;
        if (posture == Posture::relaxed) share = 0.3;
        angles[k].x() += share * (closed - angles[k].x());
      }
      // The index finger spreads to the thumb, the others away from it.
      const auto& spread = hand.bodies[first].joint.abduction_range;
      const double to_thumb = hand.side == Side::right ? 1 : 0;
      if (posture == Posture::flat && !is_thumb) angles[first].y() = spread[f == 1 ? (to_thumb > 0) : (to_thumb == 0)];
    }
    return angles;
  }

  double duration() const override { return step_ * kPostureCount; }
  const std::array<double, kJointCount>& radii() const override { return hand_.joint_radii; }
  JointFrames at(double time) const override {
    const double t = std::clamp(time, 0.0, duration() - 1e-9);
    const auto k = static_cast<std::size_t>(t / step_);
    const double share = minimum_jerk((t - static_cast<double>(k) * step_) / (0.3 * step_));
    JointAngles angles = angles_[k];
    for (std::size_t b = 0; k > 0 && b < kBodyCount; ++b)
      angles[b] = angles_[k - 1][b] + share * (angles_[k][b] - angles_[k - 1][b]);
    const Pose wrist{Vector3(0.1, 1.1, -0.3), rotation_exp(Vector3(0.2, 0.4, 0.1 * t))};
    return forward_kinematics(hand_, wrist, angles);
  }

 private:
  HandModel hand_;
  double step_;
  std::array<JointAngles, kPostureCount> angles_;
};

}  // namespace softhand::testing
