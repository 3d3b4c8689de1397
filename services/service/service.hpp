// What every service's main shares: command line, real-time loop, messages and their answers, loop status, clean stop.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "bus/bus.hpp"
#include "messages/messages.hpp"
#include "runtime/clock.hpp"
#include "runtime/signals.hpp"
#include "service/time_control.hpp"

namespace CLI {
class App;
}

namespace softhand {

struct ServiceArguments {
  std::string module;                  ///< name under which messages reach it and its status is published
  std::string config;                  ///< scene file; every service of a rig reads the same, each for its own sections
  std::vector<std::string> overrides;  ///< of `--set`
};

/// Reads `--config`, `--set`, `--module` and what `extend` adds. Prints help or the error and exits where they are
/// asked for or wrong.
ServiceArguments parse_arguments(int argc, char** argv, const std::string& module, const std::string& about,
                                 const std::function<void(CLI::App&)>& extend = {});

struct TrackerArguments : ServiceArguments {
  int strength = 0;          ///< of several trackers of one hand the strongest owns it
  std::uint32_t source = 0;  ///< id in what it publishes
};
/// The same of a tracker: `--strength` and `--source` besides.
TrackerArguments parse_tracker_arguments(int argc, char** argv, const std::string& about);

enum class Urgency {
  real_time,  ///< memory locked, priority raised, the higher the faster the loop; a warning says where that was refused
  ordinary,   ///< gives way to the others: displays
};

enum class Pacing {
  simulated,  ///< steps follow the simulated clock: slowed down and halted with the rig (time_control.hpp)
  real,       ///< whatever the simulation does: devices, whose safety is timed, what watches people, displays
};

class Service {
 public:
  /// Takes its urgency before DDS makes its threads. From here on SIGTERM and SIGINT ask for a clean stop.
  Service(const ServiceArguments& arguments, double rate_hz, Pacing pacing, Urgency urgency = Urgency::real_time);
  const bus::Participant& participant() const { return participant_; }

  /// Fills epoch, clock id and publish time (real) of what is about to be written.
  void stamp(Stamp& stamp) const;
  /// Whether somebody reads loop_status: nothing need be computed for it otherwise.
  bool status_wanted() const { return status_writer_.has_readers(); }
  /// What samples that were taken at a real time are stamped with.
  const SimulatedClock& clock() const { return time_control_.clock(); }

  struct Callbacks {
    std::function<void(Nanoseconds)> step;  ///< with the time of its start, on the clock of its pacing
    std::function<MessageReply(const Message&)> answer = nullptr;  ///< null: there is nothing that it could be told
    std::function<void(LoopStatus&, Nanoseconds)> fill_status;
    /// Of pacing `simulated`, between steps, where everything is to start over; gets the time of the message `reset`:
    /// samples until then are not to be used.
    std::function<void(Nanoseconds)> reset = nullptr;
  };
  /// Runs `step` at the rate until SIGTERM or SIGINT, answers messages, and publishes loop_status at 10 Hz. A late step
  /// is counted; missed ones are skipped, never made up for.
  void run(const Callbacks& callbacks);

 private:
  StopSignal stop_;
  TimeControl time_control_;
  std::string module_;
  double rate_hz_;
  Pacing pacing_;
  bus::Participant participant_;
  bus::Reader<Message> messages_;
  bus::Writer<MessageReply> replies_;
  bus::Writer<LoopStatus> status_writer_;
  std::uint64_t epoch_;
  std::uint32_t clock_id_;
};

/// Samples that were lost or malformed on the way to these readers: `LoopStatus::input_drops`.
template <typename... Readers>
std::uint64_t dropped_before(const Readers&... readers) {
  const auto of = [](const bus::ReaderCounters& counters) { return counters.lost + counters.refused; };
  return (of(readers.counters()) + ...);
}

/// main() of a service: `body`'s exceptions become one line on stderr and exit code 1.
int guarded_main(const std::string& module, const std::function<void()>& body);

}  // namespace softhand
