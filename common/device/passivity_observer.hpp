// Measures whether a haptic device receives commands that give the user more energy than the user put in (Hannaford and
// Ryu 2002).
//
//   E_n = E_n-1 - sum over bones of  s (f_n-1 . (x_n - x_n-1) + tau_n-1 . log(R_n R_n-1^T))
//
// The pose of the user's (tracked) bone is x, R. The coupling's force and torque on this bone are f, tau. A device
// holds them from one message to the next. The device may apply the share s of them. E is the energy that the user put
// in, minus the energy that the loop gave back. A passive loop that starts at rest keeps E >= 0. Effects of the
// device's clamp, slew limit and mechanics are not observed.
#pragma once

#include "messages/messages.hpp"

namespace softhand {

class PassivityObserver {
 public:
  /// Displacement in metres beyond which a bone was repositioned between two messages. Such a move does no work.
  static constexpr double kTeleport = 0.25;

  /// Adds the work of the previous message's forces along the motion of the user's bones to the poses in `wrench`.
  /// Real-time.
  void add(const BoneWrench& wrench);
  /// Sets the share, 0 to 1, of a message's forces that acts from now on. Call it between messages.
  void set_share(double share) { share_ = share; }
  /// E in joules.
  double energy() const { return energy_; }

 private:
  BoneWrench last_;
  bool any_ = false;
  double share_ = 1;
  double energy_ = 0;
};

}  // namespace softhand
