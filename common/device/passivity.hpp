// A time-domain passivity observer and controller for one haptic device (Hannaford and Ryu 2002).
//
//   E_n = E_n-1 - u_n-1 . (q_n - q_n-1) + P T
//
// The device held the commands u from one step to the next, and measured the positions q of its actuators. E is the
// energy that the user put into the device, minus the energy that the device gave back. A surface that moves gives
// energy or takes it: its power P is the force of its plane times its speed (LocalModel::power), so a conveyor may push
// a user for ever. A passive device that starts at rest keeps E >= 0.
//
// The controller predicts the work of the next step. If it would make E negative, the controller adds damping,
//   u' = u - b v,   b = (u . v T - E) / (T v . v),
// at most the damping that the device renders stably. If this is not enough, it lowers the commands that push along
// the motion. Commands never leave the limits of the device. The motion of one step cannot be known before, so E may be
// negative by the error of the prediction.
//
// Mechanics, delay and friction of the device are not observed: friction makes the real device more passive.
#pragma once

#include "device/local_model.hpp"

namespace softhand {

class PassivityControl {
 public:
  /// E may fall this far below zero, J, before forces become weaker. Resolution and noise of a sensor would otherwise
  /// switch the force of a device off and on while it rests.
  static constexpr double kAllowance = 3e-4;
  /// A sensor with a larger resolution is not believed, m.
  static constexpr double kCoarsest = 1e-4;

  explicit PassivityControl(const DeviceLimits& limits);

  /// Adds the work of `commands`, which acted while the device made the last step of `motion`. Real-time.
  void observe(std::span<const double> commands, const DeviceMotion& motion);
  /// Changes `commands` for the next `seconds` so that E stays at or above zero. Moving surfaces give `power` (W) with
  /// the commands `requested`, and less with weaker ones. Real-time.
  void control(std::span<double> commands, const DeviceMotion& motion, double seconds,
               std::span<const double> requested, double power);

  /// E in joules.
  double energy() const { return energy_; }
  double lowest_energy() const { return lowest_; }
  /// What E would be if all commands had passed unchanged, for the same motion.
  double energy_without_control() const { return energy_without_; }
  /// Number of steps in which the controller changed a command.
  std::uint64_t interventions() const { return interventions_; }

 private:
  /// Weakens `commands` so that their work in the next `seconds` is at most `available` J.
  void weaken(std::span<double> commands, const DeviceMotion& motion, double seconds, double available);

  std::size_t actuators_;
  double minimum_, maximum_, largest_damping_;
  double energy_ = 0, lowest_ = 0, energy_without_ = 0;
  ActuatorValues resolution_{};  // m, smallest step seen
  ActuatorValues passed_{};      // commands before the controller changed them
  double supply_ = 0;            // J that moving surfaces give in the step that begins
  double supply_without_ = 0;    // the same without the controller
  std::uint64_t interventions_ = 0;
};

}  // namespace softhand
