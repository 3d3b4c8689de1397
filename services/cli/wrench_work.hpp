// What the forces of bone_wrench would do to a hand if they acted in full on each of its bones.
#pragma once

#include <array>

#include "math/types.hpp"
#include "messages/messages.hpp"

namespace softhand {

using BonePoses = std::array<Pose, kBodyCount>;

/// Sum over bones of f . dx + tau . log(dR): the force and torque of a message act until the next message, along the
/// motion of the bone from one to the next. Positive: work on the hand. No device does this: a device has few actuators
/// and limits. It judges the messages, and not a device (`PassivityControl`).
class WrenchWork {
 public:
  /// A larger motion between two messages is a repositioned hand, m.
  static constexpr double kJump = 0.25;

  void add(const BoneWrench& wrench, const BonePoses& poses);
  double joules() const { return joules_; }

 private:
  BoneWrench last_;
  BonePoses poses_;
  bool any_ = false;
  double joules_ = 0;
};

}  // namespace softhand
