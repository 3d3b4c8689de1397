// The SDK for drivers of haptic and tactile devices: the interface of a driver, and the safety layer around every
// driver.
//
// A driver converts simulation output into requested commands, one number per actuator. It also writes commands to its
// device, and a haptic driver says the motion of its device. `DeviceLoop` stands between the two and holds everything
// that keeps a person safe: force clamp, slew limit, and zero commands. Commands are zero on stale input, on non-finite
// numbers, when disabled and on exit. For a haptic device that measures its motion, the loop also evaluates the local
// model between two inputs and keeps the device passive. A driver is one folder under services/haptics or
// services/tactile (docs/add-a-device.md).
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "device/local_model.hpp"
#include "device/passivity.hpp"
#include "messages/convert.hpp"
#include "messages/followed_writer.hpp"
#include "messages/messages.hpp"
#include "runtime/options.hpp"

namespace softhand {

/// Limits of the commands of a device. Units are the device's own: N for haptic, N or 0..1 for tactile.
struct DeviceLimits {
  std::size_t actuators = 0;   ///< 1 to kMaxActuators
  double minimum_command = 0;  ///< <= 0; a brake, which can only resist, has 0
  double maximum_command = 0;  ///< > 0
  double slew = 0;             ///< > 0, largest change per second away from zero. Towards zero there is no limit
  /// Haptic devices that measure their motion: the largest stiffness (N/m) and damping (N s/m) that the device renders
  /// stably at the rate of its loop. Stiffness 0: no local model.
  double stiffness = 0;
  double damping = 0;
  bool is_worn = false;  ///< positions are relative to the user's wrist, as those of a glove; otherwise to the room
  /// Hz. A device that lets go when it hears nothing for a while refuses a slower loop, in which it would stutter.
  double lowest_rate = 0;
};

template <typename InputType>
class DeviceDriver {
 public:
  using Input = InputType;
  virtual ~DeviceDriver() = default;
  virtual DeviceLimits limits() const = 0;
  /// Computes the requested commands for this input, one number per actuator. `requested` is zero on entry. The values
  /// need not respect the limits. Those of a haptic device must be linear in the coupling forces and torques. The local
  /// model asks for the commands of parts of an input. Real-time.
  virtual void command(const Input& input, std::span<double> requested) = 0;
  /// A haptic device that measures its motion writes the position of each actuator, m, in the direction in which a
  /// positive command pushes the user. Returns false if it does not measure or lost its sensor. Real-time.
  virtual bool measure(Nanoseconds, std::span<double> /*positions*/) { return false; }
  /// Called after a `measure` that returned true. A device that also measures velocities writes them, m/s, and returns
  /// true. Otherwise the loop computes them from the positions. Real-time.
  virtual bool measure_velocities(std::span<double>) { return false; }
  /// Called after a `measure` that returned true. A device that knows when its commands acted writes those that acted
  /// while it made its last step, and returns true. Otherwise the loop takes those of its last `write`. Real-time.
  virtual bool measure_commands(std::span<double>) { return false; }
  /// Sends commands within the limits to the device. Real-time: must not block, allocate or throw.
  virtual void write(Nanoseconds now, std::span<const double> commands) = 0;
  /// The loop hangs, perhaps in a call of this driver. Another thread calls this, again and again until the loop goes
  /// on. Lets the device go to zero, with nothing that the loop changes at the same time. Returns true if the device is
  /// at zero 20 ms later, by this call or by itself. The conformance kit asks for it.
  virtual bool release() { return false; }
  /// Whether the device is there, for its health. A device that also tracks says it by `state`. Real-time.
  virtual bool connected() const { return true; }
  /// Adds counters of the driver to the status. Must not allocate.
  virtual void fill_status(LoopStatus&) const {}
};
using TactileDriver = DeviceDriver<SkinTraction>;

/// Adds the force against closing of each finger, N, thumb first. It is the sum of the coupling forces on the finger's
/// bones, projected on the dorsal axis of the distal bone. Negative: the simulated finger pulls. Real-time.
void add_closing_resistance(const BoneWrench& input, std::span<double> forces);

struct DeviceLoopOptions {
  double rate_hz = 1000;
  double stale_after = 0.04;
  double gain = 1;
  bool enabled = true;
};
void describe(OptionVisitor& v, DeviceLoopOptions& o);

/// The section of a device in a scene: the options of the loop, and those of the driver.
template <typename Options>
struct DeviceOptions {
  DeviceLoopOptions loop;
  Options driver;
};
template <typename Options>
void describe(OptionVisitor& v, DeviceOptions<Options>& o) {
  describe(v, o.loop);
  describe(v, o.driver);
}

struct DeviceCounters {
  std::uint64_t accepted = 0;       ///< inputs
  std::uint64_t repeated = 0;       ///< inputs with an old sequence; they do not count as fresh
  std::uint64_t refused_stamp = 0;  ///< inputs from the future, or from the clock of another host
  std::uint64_t second_writer = 0;  ///< inputs of another writer than the followed one
  std::uint64_t nonfinite = 0;      ///< requested commands that were not finite and were replaced by zero
};

/// The part of the safety layer that is the same for every kind of input.
class DeviceGuard {
 public:
  /// Throws std::invalid_argument if the limits are invalid. `kind`: 0 haptic, 1 tactile.
  DeviceGuard(const DeviceLoopOptions& options, const DeviceLimits& limits, std::uint32_t device, std::uint32_t kind);

  /// Returns true if `stamp` is newer than all earlier stamps, and can be compared with this host's clock. Then the
  /// caller computes commands from this input.
  bool accept(Nanoseconds now, const HandKey& hand, const Stamp& stamp);
  /// Commands fade from this share of `stale_after` on. With 40 ms this is later than the message after a lost one at
  /// 90 Hz with 4 ms of jitter, which a user must not feel.
  static constexpr double kFadeFrom = 0.8;
  /// Falls from 1 to 0 while the age of the newest input rises from kFadeFrom * `stale_after` to `stale_after`.
  double freshness(Nanoseconds now) const;
  /// Computes the commands of this step from `requested` (its size is the number of actuators). `source_live` is false
  /// if the input itself says that its source is dead.
  const DeviceState& limit(Nanoseconds now, std::span<const double> requested, bool source_live);
  /// Sets all commands to zero immediately. Used on exit.
  const DeviceState& zero(Nanoseconds now);
  /// Calls change(std::span<double>) with the commands of the last step, before they are written. Then keeps them
  /// within the limits: a controller must not make a force jump, and commands that are off stay zero.
  template <typename F>
  void adjust(F&& change) {
    change(std::span<double>{state_.commands.begin(), state_.commands.size()});
    for (std::size_t i = 0; i < state_.commands.size(); ++i)
      state_.commands[i] = std::clamp(state_.commands[i], lowest_[i], highest_[i]);
  }
  /// Of the last step.
  std::span<const double> commands() const { return {state_.commands.begin(), state_.commands.size()}; }
  MessageReply answer(const Message& message, const std::string& module);
  void fill_status(LoopStatus& status, Nanoseconds now) const;

  const DeviceCounters& counters() const { return counters_; }

 private:
  DeviceLoopOptions options_;
  DeviceLimits limits_;
  std::uint32_t clock_id_;  // of this host
  double gain_;
  bool enabled_;
  bool any_ = false;
  bool was_live_ = false;
  Nanoseconds arrival_ = 0;
  Nanoseconds last_step_ = 0;
  FollowedWriter followed_;
  Stamp stamp_;
  DeviceState state_;
  ActuatorValues lowest_{}, highest_{};  // what the last step may command
  DeviceCounters counters_;
};

/// Coupling forces are only valid while the simulated hand is fresh. The traction comes from the simulation itself, so
/// it is always live.
inline bool source_is_live(const BoneWrench& input) { return input.simulated_valid != 0; }
inline bool source_is_live(const SkinTraction&) { return true; }

/// What the loop does with its inputs at the rate of the device.
template <typename Input>
class DeviceFeedback;

/// Tactile devices do not move the user: their commands are those of the newest input.
template <>
class DeviceFeedback<SkinTraction> {
 public:
  DeviceFeedback(const DeviceLoopOptions&, const DeviceLimits& limits) : actuators_(limits.actuators) {}
  void measure(Nanoseconds, TactileDriver&, std::span<const double>) {}
  void take(const SkinTraction& input, TactileDriver& driver) {
    requested_.fill(0);
    driver.command(input, {requested_.data(), actuators_});
  }
  std::span<const double> requested() { return {requested_.data(), actuators_}; }
  void control(std::span<double>) {}
  void fill_status(LoopStatus&) const {}

 private:
  std::size_t actuators_;
  ActuatorValues requested_{};
};

/// Local model and passivity of a haptic device.
template <>
class DeviceFeedback<BoneWrench> {
 public:
  DeviceFeedback(const DeviceLoopOptions& options, const DeviceLimits& limits)
      : period_(1 / options.rate_hz),
        actuators_(limits.actuators),
        motion_(actuators_),
        model_(limits),
        passivity_(limits) {}
  /// Asks the device for its motion. `commands` acted since the last call.
  void measure(Nanoseconds now, HapticDriver& driver, std::span<const double> commands);
  void take(const BoneWrench& input, HapticDriver& driver) { model_.take(input, motion_, driver); }
  std::span<const double> requested();
  void control(std::span<double> commands) {
    passivity_.control(commands, motion_, period_, {requested_.data(), actuators_}, model_.power());
  }
  void fill_status(LoopStatus& status) const;

  const LocalModel& model() const { return model_; }
  const PassivityControl& passivity() const { return passivity_; }

 private:
  double period_;  // s
  std::size_t actuators_;
  DeviceMotion motion_;
  LocalModel model_;
  PassivityControl passivity_;
  ActuatorValues requested_{}, positions_{}, velocities_{}, acted_{};
  bool measures_ = false;
  Nanoseconds now_ = 0;
  std::uint64_t refused_motion_ = 0;
};

template <typename Input>
class DeviceLoop {
 public:
  DeviceLoop(const DeviceLoopOptions& options, std::shared_ptr<DeviceDriver<Input>> driver, std::uint32_t device,
             std::uint32_t kind)
      : driver_(std::move(driver)),
        guard_(options, driver_->limits(), device, kind),
        feedback_(options, driver_->limits()),
        longest_pause_(std::max(kLongestPause, static_cast<Nanoseconds>(3e9 / options.rate_hz))) {}
  /// Sets the commands of the device to zero if `stop` was not called.
  ~DeviceLoop() {
    if (!stopped_) stop(0);
  }
  DeviceLoop(const DeviceLoop&) = delete;
  DeviceLoop& operator=(const DeviceLoop&) = delete;

  /// Runs one step and writes to the device. `input` is the input that arrived since the last step; null = no input.
  const DeviceState& step(Nanoseconds now, const Input* input) {
    // After a pause the device is at zero, or should be: forces begin again from there.
    const Nanoseconds last = stepped_.exchange(now);
    const bool paused = last != 0 && now - last > longest_pause_;
    if (released_.exchange(0) != 0 || paused) guard_.zero(now);
    feedback_.measure(now, *driver_, guard_.commands());
    if (input != nullptr && guard_.accept(now, input->hand, input->stamp)) {
      feedback_.take(*input, *driver_);
      source_live_ = source_is_live(*input);
    }
    const DeviceState& state = guard_.limit(now, feedback_.requested(), source_live_);
    guard_.adjust([this](std::span<double> commands) { feedback_.control(commands); });
    driver_->write(now, guard_.commands());
    return state;
  }
  /// A loop that stands still for longer hangs, or for three of its periods if they are longer.
  static constexpr Nanoseconds kLongestPause = 25'000'000;
  /// For a thread beside the loop, every few milliseconds: releases the device while the loop hangs.
  void watch(Nanoseconds now) {
    const Nanoseconds stepped = stepped_;
    if (stepped == 0 || stopped_ || now - stepped <= longest_pause_) return;
    // Again for a device that was just connected, but not so often that packets pile up.
    const Nanoseconds before = released_;
    if (before != 0 && now - before < kLongestPause) return;
    if (!driver_->release()) return;
    if (before == 0) ++releases_;
    released_ = now;
  }
  /// Sets the commands of the device to zero: on exit, also by signal.
  const DeviceState& stop(Nanoseconds now) {
    stopped_ = true;
    const DeviceState& state = guard_.zero(now);
    driver_->write(now, guard_.commands());
    return state;
  }
  MessageReply answer(const Message& message, const std::string& module) { return guard_.answer(message, module); }
  void fill_status(LoopStatus& status, Nanoseconds now) const {
    guard_.fill_status(status, now);
    feedback_.fill_status(status);
    add_counter(status, "released", static_cast<double>(releases_));
  }
  const DeviceCounters& counters() const { return guard_.counters(); }
  /// Commands of the last step.
  std::span<const double> commands() const { return guard_.commands(); }
  const DeviceFeedback<Input>& feedback() const { return feedback_; }

 private:
  std::shared_ptr<DeviceDriver<Input>> driver_;
  DeviceGuard guard_;
  DeviceFeedback<Input> feedback_;
  bool source_live_ = false;
  Nanoseconds longest_pause_;
  // Shared with the thread that watches.
  std::atomic<bool> stopped_{false};
  std::atomic<Nanoseconds> stepped_{0};   // start of the last step
  std::atomic<Nanoseconds> released_{0};  // last release since the last step; 0 = none
  std::atomic<std::uint64_t> releases_{0};
};

}  // namespace softhand
