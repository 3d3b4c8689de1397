// Code that all services share: command line, real-time loop, messages and answers, loop status, clean stop.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "bus/bus.hpp"
#include "messages/messages.hpp"
#include "runtime/clock.hpp"
#include "runtime/signals.hpp"
#include "service/rig_clock.hpp"
#include "service/time_control.hpp"

namespace softhand {

struct ServiceArguments {
  std::string role;                    ///< identity in a secured domain, one of bus::kRoles
  std::string module;                  ///< name for messages and status
  std::string config;                  ///< scene file; all services of a rig read the same file, each its own sections
  std::vector<std::string> overrides;  ///< values of `--set`
  std::string flight;                  ///< folder of `--flight`; empty: no file at the end of the process
  std::optional<int> priority;         ///< of the loop; 0: ordinary
  std::string cores;                   ///< for the loop; empty: all
};

/// Reads `--config`, `--set` and `--module`. `role` is also the default of the module name. Prints the help and exits
/// on `--help`. Prints the error and exits on a wrong command line.
ServiceArguments parse_arguments(int argc, char** argv, const std::string& role, const std::string& about);

struct TrackerArguments : ServiceArguments {
  int strength = 0;                   ///< of several trackers of one hand, the strongest one owns it
  std::uint32_t source = 0;           ///< source id in the published samples
  std::optional<std::uint32_t> user;  ///< in the published samples; empty: the user of the scene
};
/// The same for a tracker, with `--strength`, `--source` and `--user` added.
TrackerArguments parse_tracker_arguments(int argc, char** argv, const std::string& about);

struct DeviceArguments : ServiceArguments {
  std::uint32_t device = 0;  ///< id of the device, the key of device_state
};
/// The same for a haptic or tactile device, with `--device` added.
DeviceArguments parse_device_arguments(int argc, char** argv, const std::string& role, const std::string& module);

struct TrackingDeviceArguments : TrackerArguments {
  std::uint32_t device = 0;
};
/// The same for a device that tracks and pushes back, with the options of both.
TrackingDeviceArguments parse_tracking_device_arguments(int argc, char** argv, const std::string& module);

enum class Urgency {
  real_time,  ///< memory locked and priority raised (`--priority`); prints a warning if this is refused
  ordinary,   ///< lower priority than the other processes; for displays
};

enum class Pacing {
  simulated,  ///< steps follow the simulated clock; it can be slowed down or halted (time_control.hpp)
  real,       ///< steps follow real time: devices (their safety is timed), trackers of people, displays
};

class Service {
 public:
  /// Sets the urgency and the cores of the calling thread, which will run the loop. The threads of the participant are
  /// favoured above other programs, because they receive the loop's samples. Threads that are started later are
  /// ordinary. From here on SIGTERM and SIGINT request a clean stop. Takes over the simulated clock of the modules that
  /// run already, which can take seconds (`find_clock`).
  Service(const ServiceArguments& arguments, double rate_hz, Pacing pacing, Urgency urgency = Urgency::real_time);
  const bus::Participant& participant() const { return participant_; }

  /// Fills in epoch, clock id and publish time (real time) of a message before it is written.
  void stamp(Stamp& stamp) const;
  /// True if loop_status has a subscriber. Otherwise nothing needs to be computed for it.
  bool status_requested() const { return status_writer_.has_readers(); }
  /// The clock for the stamps of samples that were taken at a real time.
  const SimulatedClock& clock() const { return time_control_.clock(); }

  struct Callbacks {
    std::function<void(Nanoseconds)> step;  ///< gets the start time of the step, on the clock of its pacing
    std::function<MessageReply(const Message&)> answer = nullptr;  ///< null: the module has no message keys
    std::function<void(LoopStatus&, Nanoseconds)> fill_status;
    /// Called between steps to start over, only with pacing `simulated`. Gets the time of the message `reset`. Samples
    /// up to that time must not be used.
    std::function<void(Nanoseconds)> reset = nullptr;
    /// Called after each step with the time at which it was due. Returns by how much the later steps move. Both are on
    /// the clock of the pacing (runtime/phase_lock.hpp).
    std::function<Nanoseconds(Nanoseconds)> shift = nullptr;
  };
  /// Runs `step` at its rate until SIGTERM or SIGINT, answers messages, and publishes loop_status at 10 Hz. Late steps
  /// are counted. Missed steps are skipped and not repeated.
  void run(const Callbacks& callbacks);

 private:
  StopSignal stop_;
  std::string module_;
  double rate_hz_;
  Pacing pacing_;
  bus::Participant participant_;
  bus::Reader<Message> messages_;  // before the clock is taken over, so that it keeps the commands of that time
  TimeControl time_control_;
  bus::Writer<MessageReply> replies_;
  bus::Writer<LoopStatus> status_writer_;
  std::uint32_t clock_id_;
  ClockCheck clock_check_{participant_, module_};
};

/// Adds what a reader lost and refused to a status: `input_drops`, the counters of refused stamps and of samples of
/// second writers, and the name of the last such writer of all readers.
void count_input(LoopStatus& status, const bus::Participant& participant, const bus::ReaderCounters& counters);
template <typename... Readers>
void count_inputs(LoopStatus& status, const bus::Participant& participant, const Readers&... readers) {
  (count_input(status, participant, readers.counters()), ...);
}

/// main() of a service: an exception from `body` becomes one line on stderr and exit code 1. For a ConfigError the exit
/// code is kExitConfiguration, as for a wrong command line.
int guarded_main(const std::string& module, const std::function<void()>& body);

}  // namespace softhand
