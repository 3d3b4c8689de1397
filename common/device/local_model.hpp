// The force of a haptic device between two messages of the simulation, at the rate of the device.
//
// A message is about 11 ms old and is replaced 11 ms later. A force that is held for so long gives the user energy: it
// is too large while the user lets go. So the model evaluates the contact planes of the message (BoneSample) at the
// motion that the device measures itself:
//
//   u(q) = u_held + sum over planes p of  r_p max(0, f_p - k_p (r_p . (q - q_0) - w_p t) - b_p (r_p . v - w_p))
//
// Positions of the actuators are q, with velocity v. They were q_0 at the sample time of the message, so neither the
// age of the message nor its jitter changes the place of the plane. The row r_p has the commands of a unit force along
// the normal. The force of the message along the normal is f_p, its remainder gives u_held. The touched surface moves
// along the normal with the speed w_p, and t is the time since the sample time. Speeds are against what carries the
// device: the room, or the user's wrist (DeviceLimits::is_worn).
#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "math/types.hpp"
#include "messages/messages.hpp"

namespace softhand {

template <typename InputType>
class DeviceDriver;
using HapticDriver = DeviceDriver<BoneWrench>;
struct DeviceLimits;

using ActuatorValues = std::array<double, kMaxActuators>;

/// What the device measured: positions of its actuators at its own rate.
class DeviceMotion {
 public:
  /// A larger change between two steps is a fault of the sensor or a new calibration, and no motion, m.
  static constexpr double kJump = 0.1;
  /// A larger velocity is a fault of the device, m/s.
  static constexpr double kFastest = 10;
  /// Time over which velocities are taken, ns. It averages the resolution of a sensor.
  static constexpr Nanoseconds kVelocityTime = 4'000'000;

  explicit DeviceMotion(std::size_t actuators) : actuators_(actuators) {}
  /// Returns false if the positions are not finite or jumped. The history then begins again. Real-time.
  bool add(Nanoseconds now, std::span<const double> positions);
  /// Velocities that the device measured with the newest positions, m/s. Returns false if they are not finite or
  /// absurd: then they are computed. Real-time.
  bool set_velocities(std::span<const double> velocities);
  void clear() {
    count_ = 0;
    has_velocities_ = false;
  }
  bool empty() const { return count_ == 0; }
  /// True if the step to the newest sample is known.
  bool has_step() const { return count_ > 1; }
  /// The newest sample. The motion must not be empty.
  const ActuatorValues& positions() const { return sample(0).positions; }
  /// Change from the sample before to the newest one, m, or that change some steps ago. Zero without these samples.
  ActuatorValues step(std::size_t steps_ago = 0) const;
  /// Positions at `time`, interpolated; before and after the history its first and last ones.
  ActuatorValues at(Nanoseconds time) const;
  /// Those that the device measured, m/s. Otherwise the mean over the last kVelocityTime, zero without two samples.
  ActuatorValues velocities() const;

 private:
  struct Sample {
    Nanoseconds time = 0;
    ActuatorValues positions{};
  };
  static constexpr std::size_t kHistory = 64;
  const Sample& sample(std::size_t steps_ago) const { return ring_[(newest_ + kHistory - steps_ago) % kHistory]; }

  std::size_t actuators_;
  std::array<Sample, kHistory> ring_{};
  std::size_t newest_ = 0;
  std::size_t count_ = 0;
  bool has_velocities_ = false;
  ActuatorValues velocities_{};  // measured
};

class LocalModel {
 public:
  explicit LocalModel(const DeviceLimits& limits);
  /// Takes a new message. A plane with a value out of range is refused: its force is held. Without a motion, or with a
  /// device that renders no stiffness, all forces are held. Real-time.
  void take(const BoneWrench& input, const DeviceMotion& motion, HapticDriver& driver);
  /// Writes the commands at the newest motion. Real-time.
  void evaluate(Nanoseconds now, const DeviceMotion& motion, std::span<double> requested);
  /// Power that the moving surfaces give to the user with the commands of the last `evaluate`, W: the sum of force
  /// times w. Negative: they recede. Zero for a device that is worn: there w is mostly the noise of a tracker, and the
  /// square of noise is not zero on average.
  double power() const { return power_; }

  std::size_t planes() const { return count_; }
  /// Number of planes that were refused.
  std::uint64_t refused() const { return refused_; }

 private:
  struct Plane {
    ActuatorValues row{};
    double held = 0, force = 0, stiffness = 0, damping = 0, speed = 0;
  };
  void limit_gains();

  std::size_t actuators_;
  double largest_stiffness_, largest_damping_;
  bool is_worn_;
  Nanoseconds sample_time_ = 0;
  double power_ = 0;
  ActuatorValues held_{};
  ActuatorValues origin_{};
  std::array<Plane, kBodyCount> planes_{};
  std::size_t count_ = 0;
  std::uint64_t refused_ = 0;
  BoneWrench input_;  // with other forces
};

}  // namespace softhand
