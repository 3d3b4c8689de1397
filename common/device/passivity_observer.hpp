// Watches that what goes to a haptic device gives the user no more energy than the user put in (Hannaford and Ryu
// 2002).
//
//   E_n = E_n-1 - sum over bones of  s (f_n-1 . (x_n - x_n-1) + tau_n-1 . log(R_n R_n-1^T))
//
// with x, R the user's (tracked) bone and f, tau the coupling's force and torque on it, which a device holds from one
// message to the next, times the share s of them that it is allowed to make. E is what the user put in less what the
// loop gave back: a loop that is passive and began at rest keeps it >= 0. What a device's clamp, slew limit and
// mechanics change is not seen.
#pragma once

#include "messages/messages.hpp"

namespace softhand {

class PassivityObserver {
 public:
  /// A bone that is farther from its last place than this was put there (metres): its move does no work.
  static constexpr double kTeleport = 0.25;

  /// The user's bones have come to where `wrench` says, against the forces of the message before. Real-time.
  void add(const BoneWrench& wrench);
  /// The share of a message's forces, 0 to 1, that acts from now on. Called between messages.
  void set_share(double share) { share_ = share; }
  /// E, joules.
  double energy() const { return energy_; }

 private:
  BoneWrench last_;
  bool any_ = false;
  double share_ = 1;
  double energy_ = 0;
};

}  // namespace softhand
