#include "service/service.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>

#include "device/answer.hpp"
#include "device/health.hpp"
#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "runtime/config.hpp"
#include "runtime/exit_codes.hpp"
#include "runtime/periodic_loop.hpp"
#include "runtime/scheduling.hpp"

namespace softhand {
namespace {

constexpr Nanoseconds kStatusPeriod = 100'000'000;
// Messages are taken and answered inside the loop. So a flood of them must not make a step late, neither by the work
// nor by waiting for the thread that receives them.
constexpr Nanoseconds kMessagePeriod = 10'000'000;
constexpr int kMostAnswers = 4;  // each time

// Rate-monotonic priorities: a loop at 1 kHz must not wait for the end of a step of the hand.
int priority_of(double rate_hz) { return rate_hz >= 500 ? 30 : rate_hz >= 200 ? 25 : 20; }

int priority_of(const ServiceArguments& arguments, double rate_hz, Urgency urgency) {
  return urgency == Urgency::ordinary ? 0 : arguments.priority.value_or(priority_of(rate_hz));
}

void warn(const std::string& module, const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) std::fprintf(stderr, "%s: %s\n", module.c_str(), warning.c_str());
}

// The member module_ is initialised before participant_, because the DDS threads get the stacks and the niceness that
// are set here.
std::string prepared(const ServiceArguments& arguments, double rate_hz, Urgency urgency) {
  if (urgency == Urgency::real_time) warn(arguments.module, lock_memory());
  if (priority_of(arguments, rate_hz, urgency) > 0) warn(arguments.module, favour_new_threads());
  return arguments.module;
}

// The number of other hosts, how many of their clocks are not known, and the largest uncertainty of the others. Also
// the beacons of hosts for which there was no room.
void count_clocks(LoopStatus& status, const bus::Participant& participant) {
  const auto clocks = participant.clocks();
  if (clocks.empty()) return;
  double unknown = 0, uncertainty = 0;
  for (const HostClock& clock : clocks) {
    unknown += is_known(clock) ? 0 : 1;
    uncertainty = std::max(uncertainty, is_known(clock) ? clock.uncertainty : 0);
  }
  add_counter(status, "other_hosts", static_cast<double>(clocks.size()));
  add_counter(status, "unknown_clocks", unknown);
  add_counter(status, "clock_uncertainty_ms", 1e3 * uncertainty);
  add_counter(status, "refused_beacons", static_cast<double>(participant.refused_beacons()));
}

// `extend` adds options to those that every service has.
ServiceArguments parse_with(int argc, char** argv, const std::string& role, const std::string& module,
                            const std::string& about, const std::function<void(CLI::App&)>& extend) {
  ServiceArguments arguments;
  arguments.role = role;
  arguments.module = module;
  CLI::App app(about);
  app.add_option("--config", arguments.config, "Scene file (TOML); keys: `softhand reference`")
      ->required()
      ->type_name("FILE");
  app.add_option("--set", arguments.overrides, "Override one key of the scene; repeatable")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  app.add_option("--flight", arguments.flight,
                 "Folder for the files of the flight recorder; one file is written when the process stops. Modules "
                 "without a recorder ignore it")
      ->envname("SOFTHAND_FLIGHT")
      ->type_name("DIR");
  app.add_option("--module", arguments.module,
                 "Module name of this process for messages and status, at most 63 characters")
      ->capture_default_str()
      ->check([](const std::string& name) {
        return name.empty() || name.size() >= sizeof(ShortText) ? "expected 1 to 63 characters" : std::string();
      });
  app.add_option(
         "--priority", arguments.priority,
         "Real-time priority of the loop; 0 = ordinary. Default: 30, 25 or 20 by its rate. The threads that receive "
         "samples have a niceness of -15, and all other threads are ordinary")
      ->check(CLI::Range(0, 99));
  app.add_option("--cores", arguments.cores, "Cores for the loop, e.g. 2 or 0-1,3; default: all")
      ->type_name("LIST")
      ->check([](const std::string& text) {
        try {
          parse_cores(text);
        } catch (const std::invalid_argument& problem) {
          return std::string(problem.what());
        }
        return std::string();
      });
  extend(app);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    std::exit(app.exit(error) == 0 ? 0 : kExitConfiguration);
  }
  return arguments;
}

void add_tracker_options(CLI::App& app, TrackerArguments& arguments) {
  app.add_option("--strength", arguments.strength,
                 "Priority among several trackers of one hand: the strongest healthy one owns the hand")
      ->capture_default_str()
      ->check(CLI::Range(0, kMostStrength));
  app.add_option("--source", arguments.source, "Id of this source")->capture_default_str();
  app.add_option(
         "--user", arguments.user,
         "User of the published hands and heads. Default: `user` of the scene. With another one this tracker is "
         "a source of softhand-tracker-fusion")
      ->check(CLI::Range(0, 15));
}
void add_device_option(CLI::App& app, std::uint32_t& device) {
  app.add_option("--device", device, "Id of this device (key of device_state)")->capture_default_str();
}

}  // namespace

ServiceArguments parse_arguments(int argc, char** argv, const std::string& role, const std::string& about) {
  return parse_with(argc, argv, role, role, about, [](CLI::App&) {});
}

TrackerArguments parse_tracker_arguments(int argc, char** argv, const std::string& about) {
  TrackerArguments arguments;
  static_cast<ServiceArguments&>(arguments) =
      parse_with(argc, argv, "tracker", "tracker", about, [&](CLI::App& app) { add_tracker_options(app, arguments); });
  return arguments;
}

DeviceArguments parse_device_arguments(int argc, char** argv, const std::string& role, const std::string& module) {
  DeviceArguments arguments;
  static_cast<ServiceArguments&>(arguments) =
      parse_with(argc, argv, role, module, "Driver of a haptic or tactile device",
                 [&](CLI::App& app) { add_device_option(app, arguments.device); });
  return arguments;
}

TrackingDeviceArguments parse_tracking_device_arguments(int argc, char** argv, const std::string& module) {
  TrackingDeviceArguments arguments;
  static_cast<ServiceArguments&>(arguments) =
      parse_with(argc, argv, "glove", module, "Driver of a device that tracks and pushes back", [&](CLI::App& app) {
        add_tracker_options(app, arguments);
        add_device_option(app, arguments.device);
      });
  return arguments;
}

Service::Service(const ServiceArguments& arguments, double rate_hz, Pacing pacing, Urgency urgency)
    : module_(prepared(arguments, rate_hz, urgency)),
      rate_hz_(rate_hz),
      pacing_(pacing),
      participant_(module_, bus::domain_from_environment(), {}, arguments.role),
      messages_(participant_, bus::topics::message),
      time_control_(find_clock(participant_)),
      replies_(participant_, bus::topics::message_reply),
      status_writer_(participant_, bus::topics::loop_status),
      clock_id_(clock_id()) {
  // After the threads of DDS have started, because these are for the loop.
  if (const int priority = priority_of(arguments, rate_hz, urgency); priority > 0)
    warn(module_, request_real_time(priority));
  if (arguments.cores.empty()) return;
  const cpu_set_t cores = parse_cores(arguments.cores);
  if (sched_setaffinity(0, sizeof cores, &cores) != 0)
    std::fprintf(stderr, "%s: cores %s refused (%s)\n", module_.c_str(), arguments.cores.c_str(), std::strerror(errno));
}

void Service::stamp(Stamp& out) const {
  out.epoch = participant_.epoch();
  out.clock_id = clock_id_;
  out.publish_time = now();
}

void Service::run(const Callbacks& callbacks) {
  const auto answer = [&](const Message& message) {
    if (callbacks.answer) return callbacks.answer(message);
    return reply_to(message, module_, kReplyIgnored,
                    is_addressed(message, module_) ? "unknown key; this module has none" : "not for this module");
  };
  PeriodicLoop loop(rate_hz_);
  LoopStatus status;
  MessageReply reply;
  std::uint64_t status_sequence = 0;
  std::uint64_t reply_sequence = 0;
  Nanoseconds next_status = now() + kStatusPeriod;
  Nanoseconds next_messages = 0;
  const SimulatedClock real_clock;
  const SimulatedClock& own_clock = pacing_ == Pacing::simulated ? clock() : real_clock;
  Nanoseconds newest = 0;
  const auto step = [&](Nanoseconds start) {
    if (pacing_ == Pacing::simulated && callbacks.reset) {
      if (const auto reset = time_control_.take_reset(now())) callbacks.reset(*reset);
    }
    // A command that arrived after its effective time could move the clock backwards.
    newest = std::max(newest, start);
    callbacks.step(newest);
    if (callbacks.shift) loop.shift(callbacks.shift(loop.due()));
  };
  const auto between = [&](Nanoseconds real) {
    if (real >= next_messages) {
      next_messages = real + kMessagePeriod;
      messages_.take_some(kMostAnswers, [&](const Message& message) {
        const bool may_reset = get_text(message.key) != "reset" || callbacks.reset;
        const auto steered = may_reset ? time_control_.answer(message, module_, real) : std::nullopt;
        reply = steered ? *steered : answer(message);
        reply.stamp.sequence = ++reply_sequence;
        reply.stamp.sample_time = real;
        stamp(reply.stamp);
        replies_.write(reply);
      });
    }
    if (real < next_status) return;
    next_status = real + kStatusPeriod;
    if (!status_requested()) return;
    status = LoopStatus{};
    set_text(status.module, module_);
    loop.fill(status);
    callbacks.fill_status(status, own_clock.at(real));
    count_inputs(status, participant_, messages_);
    if (pacing_ == Pacing::simulated) add_clock(status, clock(), real);
    count_clocks(status, participant_);
    status.stamp.sequence = ++status_sequence;
    status.stamp.sample_time = real;
    stamp(status.stamp);
    status_writer_.write(status);
  };
  loop.run(stop_.flag(), own_clock, step, between);
}

void count_input(LoopStatus& status, const bus::Participant& participant, const bus::ReaderCounters& counters) {
  status.input_drops +=
      counters.lost + counters.refused + counters.crowded + counters.refused_stamp + counters.second_writer;
  add_to_counter(status, "refused_stamp", static_cast<double>(counters.refused_stamp));
  add_to_counter(status, "second_writer", static_cast<double>(counters.second_writer));
  if (counters.second_writer == 0) return;
  const bus::SecondWriterText text = participant.second_writer();
  if (!get_text(text).empty()) status.second_writer = text;
}

int guarded_main(const std::string& module, const std::function<void()>& body) {
  try {
    body();
    return 0;
  } catch (const ConfigError& error) {
    std::fprintf(stderr, "%s: %s\n", module.c_str(), error.what());
    return kExitConfiguration;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", module.c_str(), error.what());
    return 1;
  }
}

}  // namespace softhand
