// What every service's main shares: command line, configuration, real-time loop, messages and their answers, loop status, clean stop.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "bus/bus.hpp"
#include "messages/messages.hpp"
#include "runtime/config.hpp"

namespace CLI {
class App;
}

namespace softhand {

/// CLOCK_MONOTONIC.
Nanoseconds monotonic_now();

struct ServiceArguments {
  std::string module;                  ///< name under which messages reach it and its status is published
  std::string config;                  ///< TOML file; empty = defaults
  std::vector<std::string> overrides;  ///< of `--set`
  HandKey hand;
  double seconds = 0;  ///< stop after this; 0 = on a signal
};

/// Reads `--config`, `--set`, `--user`, `--side`, `--module`, `--seconds` and what `extend` adds. Prints help or the error and exits where
/// they are asked for or wrong.
ServiceArguments parse_arguments(int argc, char** argv, const std::string& module, const std::string& about,
                                 const std::function<void(CLI::App&)>& extend = {});

/// Reads the file and then the overrides into `options`. `foreign` are sections of a shared scene file that other programs read. Overrides
/// of such sections are passed over too, so that one list of `--set` serves a whole rig.
template <typename Options>
void configure(Options& options, const ServiceArguments& arguments, const std::vector<std::string_view>& foreign) {
  if (!arguments.config.empty()) read_toml(options, arguments.config, foreign);
  for (const std::string& override_text : arguments.overrides) {
    const std::string_view section = std::string_view(override_text).substr(0, override_text.find_first_of(".=["));
    bool other = false;
    for (const std::string_view name : foreign) other = other || name == section;
    if (!other) apply_override(options, override_text);
  }
}

/// The sections of a scene, for `foreign`, less `own`.
std::vector<std::string_view> other_sections(const std::vector<std::string_view>& own);

/// Where a hand file is: `name` itself, or in config/hands of the working directory or beside the build that runs.
std::string find_hand_file(const std::string& name);

class Service {
 public:
  /// Locks memory and raises the thread's priority before DDS makes its threads; a warning says where that was refused.
  explicit Service(const ServiceArguments& arguments);
  const bus::Participant& participant() const { return participant_; }

  /// Fills epoch, clock id and publish time of what is about to be written.
  void stamp(Stamp& stamp) const;

  struct Callbacks {
    std::function<void(Nanoseconds)> step;
    std::function<MessageReply(const Message&)> answer;
    std::function<void(LoopStatus&, Nanoseconds)> fill_status;
  };
  /// Runs `step` at `rate_hz` until SIGTERM, SIGINT or `seconds`. A late step is counted; missed ones are skipped, never made up for.
  void run(double rate_hz, const Callbacks& callbacks);

 private:
  ServiceArguments arguments_;
  bus::Participant participant_;
  bus::Reader<Message> messages_;
  bus::Writer<MessageReply> replies_;
  bus::Writer<LoopStatus> status_writer_;
  std::uint64_t epoch_;
  std::uint32_t clock_id_;
};

/// main() of a service: `body`'s exceptions become one line on stderr and exit code 1.
int guarded_main(const std::string& module, const std::function<void()>& body);

}  // namespace softhand
