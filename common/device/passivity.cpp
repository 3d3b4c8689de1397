#include "device/passivity.hpp"

#include <algorithm>
#include <cmath>

#include "device/device_loop.hpp"

namespace softhand {

PassivityControl::PassivityControl(const DeviceLimits& limits)
    : actuators_(limits.actuators),
      minimum_(limits.minimum_command),
      maximum_(limits.maximum_command),
      largest_damping_(limits.damping) {
  resolution_.fill(kCoarsest);
}

void PassivityControl::observe(std::span<const double> commands, const DeviceMotion& motion) {
  const ActuatorValues step = motion.step();
  for (std::size_t i = 0; i < actuators_; ++i) {
    const double size = std::abs(step[i]);
    if (size > 0) resolution_[i] = std::min(resolution_[i], size);
    energy_ -= commands[i] * step[i];
    energy_without_ -= passed_[i] * step[i];
  }
  if (motion.has_step()) {
    energy_ += supply_;
    energy_without_ += supply_without_;
  }
  supply_ = supply_without_ = 0;
  lowest_ = std::min(lowest_, energy_);
}

void PassivityControl::control(std::span<double> commands, const DeviceMotion& motion, double seconds,
                               std::span<const double> requested, double power) {
  std::copy_n(commands.begin(), actuators_, passed_.begin());
  if (motion.empty()) return;
  // Commands that the limits of the device made weaker get a part of the power.
  const auto supply = [&] {
    double dot = 0, size = 0;
    for (std::size_t i = 0; i < actuators_; ++i) {
      dot += commands[i] * requested[i];
      size += requested[i] * requested[i];
    }
    return size > 0 ? std::clamp(dot / size, 0.0, 1.0) * power * seconds : 0.0;
  };
  supply_without_ = supply();
  weaken(commands, motion, seconds, energy_ + kAllowance + supply_without_);
  supply_ = supply();
}

void PassivityControl::weaken(std::span<double> commands, const DeviceMotion& motion, double seconds,
                              double available) {
  const ActuatorValues velocities = motion.velocities(), step = motion.step(), before = motion.step(1);
  // The most work that a command can do in the next step. The mean motion is late after a reversal. The last step, also
  // with its acceleration, is not, but has the resolution of the sensor. Whatever gives the user most counts. Without a
  // clear motion against the command, the device may move by one step of its sensor.
  const auto work_of = [&](std::size_t i) {
    const double mean = commands[i] * velocities[i] * seconds;
    const double newest = std::max(commands[i] * step[i], commands[i] * (2 * step[i] - before[i]));
    if (mean < 0 && newest <= 0) return mean;
    return std::max({mean, newest, std::abs(commands[i]) * resolution_[i]});
  };
  double given = 0, taken = 0, speed = 0;
  const auto exceeds = [&] {
    given = taken = 0;
    for (std::size_t i = 0; i < actuators_; ++i) (work_of(i) > 0 ? given : taken) += work_of(i);
    return given > 0 && given + taken > available;
  };
  if (!exceeds()) return;
  ++interventions_;
  for (std::size_t i = 0; i < actuators_; ++i) speed += velocities[i] * velocities[i];
  if (speed > 0) {
    const double damping = std::min((given + taken - available) / (seconds * speed), largest_damping_);
    for (std::size_t i = 0; i < actuators_; ++i)
      commands[i] = std::clamp(commands[i] - damping * velocities[i], minimum_, maximum_);
    if (!exceeds()) return;
  }
  const double share = std::clamp((available - taken) / given, 0.0, 1.0);
  for (std::size_t i = 0; i < actuators_; ++i)
    if (work_of(i) > 0) commands[i] *= share;
}

}  // namespace softhand
