// A motion of one hand over time, recorded or generated: joint frames in the world, without imperfections.
#pragma once

#include <algorithm>
#include <array>
#include <span>
#include <string>
#include <vector>

#include "math/types.hpp"
#include "model/hand_model.hpp"

namespace softhand {

/// Palm joint for a source without one (WebXR): halfway along the middle metacarpal.
inline Pose palm_between(const Pose& middle_metacarpal, const Pose& middle_proximal) {
  return {0.5 * (middle_metacarpal.position + middle_proximal.position), middle_metacarpal.orientation};
}

/// A named part of a motion, in seconds from its start.
struct MotionPhase {
  std::string name;  ///< approach, close, settle, lift, hold, shake, turn, turn_other, return, lower, place, squeeze,
                     ///< release, retreat; open
  double begin = 0;
  double end = 0;
};

/// Rises from 0 to 1 while `share` rises from 0 to 1, clamped. Velocity and acceleration are zero at both ends.
inline double minimum_jerk(double share) {
  const double s = std::clamp(share, 0.0, 1.0);
  return s * s * s * (10 + s * (6 * s - 15));
}

class Motion {
 public:
  virtual ~Motion() = default;
  virtual double duration() const = 0;  ///< seconds
  /// Joint frames at `time`, clamped to [0, duration].
  virtual JointFrames at(double time) const = 0;
  /// Sample times of a recording, ascending from 0. Empty for a motion that is defined at every time.
  virtual std::span<const double> times() const { return {}; }
  /// Empty if the motion has no named parts.
  virtual std::vector<MotionPhase> phases() const { return {}; }
  virtual const std::array<double, kJointCount>& radii() const = 0;  ///< metres
  /// True if the source has no palm joint. The palm is then placed between the middle metacarpal and proximal joints.
  virtual bool palm_inferred() const { return false; }
};

}  // namespace softhand
