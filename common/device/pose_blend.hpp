// The difference between two poses, which fades out. It leads a hand from one source to another without a jump.
#pragma once

#include <algorithm>
#include <limits>

#include "math/rotation.hpp"
#include "messages/messages.hpp"

namespace softhand {

/// The share of the difference is 1 at the start and 0 after the blend time, with zero slope at both ends. A plain
/// value. Real-time.
struct PoseBlend {
  Nanoseconds start = std::numeric_limits<Nanoseconds>::min() / 2;  ///< long ago
  Vector3 translation = Vector3::Zero();
  Vector3 rotation = Vector3::Zero();

  /// From now on `apply` leads from `old_pose` to the pose that it gets. `new_pose` is that pose at `time`.
  void begin(Nanoseconds time, const Pose& old_pose, const Pose& new_pose) {
    start = time;
    translation = old_pose.position - new_pose.position;
    rotation = rotation_log(old_pose.orientation * new_pose.orientation.conjugate());
  }
  /// `seconds`: the blend time.
  Pose apply(Nanoseconds time, double seconds, const Pose& pose) const {
    const double u = progress(time, seconds);
    if (u >= 1) return pose;
    const double share = 1 - u * u * (3 - 2 * u);
    return increment(pose, share * translation, share * rotation);
  }
  /// The velocity that `apply` adds.
  Twist velocity(Nanoseconds time, double seconds) const {
    const double u = progress(time, seconds);
    if (u >= 1) return {};
    const double rate = -6 * u * (1 - u) / seconds;
    return {rate * translation, rate * rotation};
  }

 private:
  double progress(Nanoseconds time, double seconds) const {
    const double passed = static_cast<double>(time - start) * kSecondsPerNanosecond;
    return passed < seconds ? std::max(0.0, passed / seconds) : 1;
  }
};

}  // namespace softhand
