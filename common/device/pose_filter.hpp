// A low-pass filter of a pose whose cutoff grows with the speed. At rest it removes noise, and fast motion passes with
// little lag. It is the One Euro filter (Casiez, Roussel and Vogel, CHI 2012, equations 1 to 6) with one change: the
// cutoff grows with the square of the speed, not with the speed. The noise of a tracker looks like a slow motion, about
// 0.02 m/s for 1 mm and 1 degree, and the square opens the filter less there (docs/devices.md).
#pragma once

#include "math/low_pass.hpp"
#include "math/rotation.hpp"
#include "math/types.hpp"

namespace softhand {

struct PoseFilter {
  /// Starts again at rest at `pose`.
  void restart(const Pose& pose) {
    newest = filtered = pose;
    velocity = {};
  }
  /// Adds a sample that was measured `elapsed` seconds (> 0) after the last one, and returns the filtered pose.
  /// `cutoff`: Hz, at rest. `doubling_speed`: m/s, > 0; at this speed the cutoff is twice that of rest.
  const Pose& add(const Pose& sample, double elapsed, double cutoff, double doubling_speed) {
    const double gain_of_speed = low_pass_gain(kCutoffOfDerivative, elapsed);
    const Vector3 linear = (sample.position - newest.position) / elapsed;
    const Vector3 angular = rotation_log(sample.orientation * newest.orientation.conjugate()) / elapsed;
    velocity.linear += gain_of_speed * (linear - velocity.linear);
    velocity.angular += gain_of_speed * (angular - velocity.angular);
    newest = sample;
    const double speed = (velocity.linear.norm() + kLever * velocity.angular.norm()) / doubling_speed;
    const double gain = low_pass_gain(cutoff * (1 + speed * speed), elapsed);
    filtered = increment(filtered, gain * (sample.position - filtered.position),
                         gain * rotation_log(sample.orientation * filtered.orientation.conjugate()));
    return filtered;
  }

  static constexpr double kCutoffOfDerivative = 1;  // Hz, as in the paper
  static constexpr double kLever = 0.05;            // m, from a joint to the end of its bone: the speed of a rotation
  Pose newest;                                      // as measured
  Pose filtered;
  Twist velocity;  // of `newest`, filtered
};

}  // namespace softhand
