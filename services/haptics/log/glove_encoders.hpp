// What the encoders of a force-feedback glove measure: how far each finger opened.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "math/types.hpp"
#include "model/skeleton.hpp"

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

}  // namespace softhand
