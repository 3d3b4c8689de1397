// What the encoders of a force-feedback glove measure: how far each finger opened. And fingers that move as those of a
// person do, for a glove that nobody wears.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>

#include "math/types.hpp"
#include "model/skeleton.hpp"
#include "runtime/clock.hpp"

namespace softhand {

/// Sums the way of each distal bone along its dorsal axis, relative to the wrist. A glove pushes the fingers away from
/// the palm and is carried by the hand, so a motion of the whole hand does no work.
class GloveEncoders {
 public:
  /// The new pose of the wrist and of the joint of each distal bone, thumb first, in one frame. A finger with NaN keeps
  /// its position.
  void move(const Pose& wrist, const std::array<Pose, kFingerCount>& distal) {
    for (std::size_t f = 0; f < kFingerCount; ++f) {
      const Pose pose = wrist.inverse() * distal[f];
      const Vector3 back = pose.orientation * Vector3::UnitY();
      if (!std::isfinite(back.sum() + pose.position.sum())) continue;
      if (any_) positions_[f] += back.dot(pose.position - last_[f]);
      last_[f] = pose.position;
    }
    any_ = true;
  }
  bool read(std::span<double> positions) const {
    if (any_) std::copy(positions_.begin(), positions_.end(), positions.begin());
    return any_;
  }

 private:
  std::array<double, kFingerCount> positions_{};  // m
  std::array<Vector3, kFingerCount> last_{Vector3::Zero(), Vector3::Zero(), Vector3::Zero(), Vector3::Zero(),
                                          Vector3::Zero()};
  bool any_ = false;
};

/// Fingers that follow the tracked ones, each as a mass on a critically damped spring. A tracked hand jumps with each
/// sample by the noise of its tracker, and a finger cannot jump. Nothing pushes these fingers: they do not give way.
class SmoothFingers {
 public:
  /// Angular frequency of the springs, rad/s: 10 Hz, about the fastest that a person moves a finger to and fro.
  static constexpr double kFrequency = 2 * std::numbers::pi * 10;

  /// `targets`: positions of the tracked fingers from now on, m. `positions`: those of the fingers.
  void follow(Nanoseconds now, std::span<const double, kFingerCount> targets, std::span<double> positions) {
    const double time = any_ ? static_cast<double>(now - last_) * 1e-9 : 0;
    const double decay = std::exp(-kFrequency * time);
    for (std::size_t f = 0; f < kFingerCount; ++f) {
      if (!any_) position_[f] = target_[f] = targets[f];
      // The exact motion towards the former target, which did not change until now.
      const double away = position_[f] - target_[f], push = velocity_[f] + kFrequency * away;
      position_[f] = target_[f] + decay * (away + push * time);
      velocity_[f] = decay * (velocity_[f] - kFrequency * push * time);
      target_[f] = targets[f];
      positions[f] = position_[f];
    }
    last_ = now;
    any_ = true;
  }

 private:
  std::array<double, kFingerCount> position_{}, velocity_{}, target_{};  // m, m/s
  Nanoseconds last_ = 0;
  bool any_ = false;
};

}  // namespace softhand
