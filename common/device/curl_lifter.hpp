// Turns curls and splays of fingers into the 26 joints of a hand, by the hand's own ranges of motion. For gloves, which
// do not know where the hand is.
#pragma once

#include <array>

#include "messages/messages.hpp"
#include "model/kinematics.hpp"

namespace softhand {

/// What a glove measures of one finger.
struct FingerCurl {
  bool valid = false;
  /// Of the finger's three joints, from the palm to the tip. The first one is the proximal joint, for the thumb the
  /// metacarpal joint. 0 = open, 1 = closed.
  std::array<double, 3> curl{};
  double splay = 0;  ///< rad, of the first joint; positive = towards the side of the thumb, on both hands
};

class CurlLifter {
 public:
  /// Mirrors the hand model if it is of the other side.
  CurlLifter(const HandModel& hand, Side side);

  /// A curl of 0 is the open hand (`open_hand`), and 1 is the end of the joint's range. Splay is limited to the range.
  /// Fills joints, flags, radii, side and frame of `out`: the wrist is at the origin of frame 2 and not tracked, and
  /// joints of fingers that are not valid are not valid. Curls outside 0 to 1 are clamped. Does not allocate.
  void lift(const std::array<FingerCurl, kFingerCount>& fingers, Skeleton& out) const;

 private:
  HandModel hand_;
  JointAngles open_;
};

}  // namespace softhand
