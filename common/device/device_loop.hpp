// The SDK for drivers of haptic and tactile devices: the interface of a driver, and the safety layer around every
// driver.
//
// A driver converts simulation output into requested commands, one number per actuator. It also writes commands to its
// device. `DeviceLoop` stands between the two and holds everything that keeps a person safe: force clamp, slew limit,
// and zero commands. Commands are zero on stale input, on non-finite numbers, when disabled and on exit. A driver is
// one folder under services/haptics or services/tactile (docs/add-a-device.md).
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "device/passivity_observer.hpp"
#include "messages/followed_writer.hpp"
#include "messages/messages.hpp"
#include "runtime/options.hpp"

namespace softhand {

/// Limits of the commands of a device. Units are the device's own: N for haptic, N or 0..1 for tactile.
struct DeviceLimits {
  std::size_t actuators = 0;   ///< 1 to kMaxActuators
  double minimum_command = 0;  ///< <= 0; a brake, which can only resist, has 0
  double maximum_command = 0;  ///< > 0
  double slew = 0;             ///< > 0, largest change per second
};

template <typename InputType>
class DeviceDriver {
 public:
  using Input = InputType;
  virtual ~DeviceDriver() = default;
  virtual DeviceLimits limits() const = 0;
  /// Computes the requested commands for this input, one number per actuator. `requested` is zero on entry. The values
  /// need not respect the limits. Real-time.
  virtual void command(const Input& input, std::span<double> requested) = 0;
  /// Sends commands within the limits to the device. Real-time: must not block, allocate or throw.
  virtual void write(Nanoseconds now, std::span<const double> commands) = 0;
};
using HapticDriver = DeviceDriver<BoneWrench>;
using TactileDriver = DeviceDriver<Contacts>;

/// Adds the force against closing of each finger, N, thumb first: the sum of the coupling forces on the finger's bones,
/// projected on the dorsal axis of the distal bone. Negative: the simulated finger pulls. Real-time.
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
  /// True while the newest input is not older than `stale_after`.
  bool fresh(Nanoseconds now) const;
  /// Computes the commands of this step from `requested` (its size is the number of actuators). `source_live` is false
  /// if the input itself says that its source is dead.
  const DeviceState& limit(Nanoseconds now, std::span<const double> requested, bool source_live);
  /// Sets all commands to zero immediately. Used on exit.
  const DeviceState& zero(Nanoseconds now);
  MessageReply answer(const Message& message, const std::string& module);
  void fill_status(LoopStatus& status, Nanoseconds now) const;
  /// Share of the driver's requested command (before clamp and slew limit) that the device receives since the last
  /// step.
  double share() const { return enabled_ && state_.live != 0 ? gain_ : 0.0; }

  std::span<const double> commands() const { return {state_.commands.begin(), state_.commands.size()}; }
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
  DeviceCounters counters_;
};

/// Coupling forces are only valid while the simulated hand is fresh. Contacts come from the simulation itself, so they
/// are always live.
inline bool source_is_live(const BoneWrench& input) { return input.simulated_valid != 0; }
inline bool source_is_live(const Contacts&) { return true; }

/// Tactile devices do not move the user, so only coupling forces are observed.
inline void observe(PassivityObserver& observer, const BoneWrench& input) { observer.add(input); }
inline void observe(PassivityObserver&, const Contacts&) {}

template <typename Input>
class DeviceLoop {
 public:
  DeviceLoop(const DeviceLoopOptions& options, std::shared_ptr<DeviceDriver<Input>> driver, std::uint32_t device,
             std::uint32_t kind)
      : driver_(std::move(driver)),
        guard_(options, driver_->limits(), device, kind),
        actuators_(driver_->limits().actuators) {}
  /// Sets the commands of the device to zero if `stop` was not called.
  ~DeviceLoop() {
    if (!stopped_) stop(0);
  }
  DeviceLoop(const DeviceLoop&) = delete;
  DeviceLoop& operator=(const DeviceLoop&) = delete;

  /// Runs one step and writes to the device. `input` is the input that arrived since the last step; null = no input.
  const DeviceState& step(Nanoseconds now, const Input* input) {
    if (input != nullptr && guard_.accept(now, input->hand, input->stamp)) {
      observe(passivity_, *input);
      requested_.fill(0);
      driver_->command(*input, {requested_.data(), actuators_});
      source_live_ = source_is_live(*input);
    }
    const DeviceState& state = guard_.limit(now, {requested_.data(), actuators_}, source_live_);
    passivity_.set_share(guard_.share());
    driver_->write(now, guard_.commands());
    return state;
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
    status.passivity_energy = passivity_.energy();
  }
  const DeviceCounters& counters() const { return guard_.counters(); }
  const PassivityObserver& passivity() const { return passivity_; }

 private:
  std::shared_ptr<DeviceDriver<Input>> driver_;
  DeviceGuard guard_;
  PassivityObserver passivity_;
  std::size_t actuators_;
  std::array<double, kMaxActuators> requested_{};
  bool source_live_ = false;
  bool stopped_ = false;
};

}  // namespace softhand
