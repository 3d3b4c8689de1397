#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "bus/bus.hpp"
#include "cli/check.hpp"
#include "cli/commands.hpp"
#include "cli/outcome.hpp"
#include "cli/rig.hpp"
#include "cli/status_table.hpp"
#include "cli/supervisor.hpp"
#include "cli/topic_recording.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "runtime/config.hpp"
#include "runtime/signals.hpp"
#include "scene_file.hpp"
#include "service/time_control.hpp"

namespace softhand {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;
constexpr int kHistory = 64;  // of each stream, so that a look every 5 ms misses none

// Listens to what a summary needs, and to nothing when no summary is asked for: a topic that nobody reads is not computed.
class Listener {
 public:
  Listener(const bus::Participant& participant, bool everything)
      : status_(participant, with_history(bus::topics::loop_status, kHistory)), messages_(participant, bus::topics::message) {
    if (everything) streams_.emplace(participant);
  }

  void poll() {
    status_.take_all([this](const LoopStatus& status) { modules_[std::string(get_text(status.module))] = status; });
    messages_.take_all([this](const Message& message) {
      // Whoever is started from now on inherits what the clock was commanded.
      if (time_control_.answer(message, "", now())) setenv(TimeControl::kVariable, time_control_.clock().text().c_str(), 1);
    });
    if (!streams_) return;
    streams_->tracked.take_all([this](const Skeleton& m) { outcome_.on_tracked(m); });
    streams_->simulated.take_all([this](const Skeleton& m) { outcome_.on_simulated(m); });
    streams_->contacts.take_all([this](const Contacts& m) { outcome_.on_contacts(m); });
    streams_->coupling.take_all([this](const ObjectCoupling& m) { outcome_.on_coupling(m); });
    streams_->objects.take_all([this](const WorldObjects& m) { outcome_.on_objects(m); });
    streams_->wrench.take_all([this](const BoneWrench& m) { outcome_.on_bone_wrench(m); });
    streams_->device.take_all([this](const DeviceState& m) { outcome_.on_device(m); });
  }
  const std::map<std::string, LoopStatus>& modules() const { return modules_; }
  const Outcome& outcome() const { return outcome_; }
  /// When the tracker's motion began, on the messages' clock; 0 = not heard.
  Nanoseconds motion_start() const {
    for (const auto& [name, status] : modules_) {
      for (const NamedValue& counter : status.counters) {
        if (get_text(counter.name) == "motion_start_s") return static_cast<Nanoseconds>(counter.value * 1e9);
      }
    }
    return 0;
  }

 private:
  struct Streams {
    explicit Streams(const bus::Participant& p)
        : tracked(p, with_history(bus::topics::tracked_skeleton, kHistory)), simulated(p, with_history(bus::topics::simulated_skeleton, kHistory)),
          contacts(p, with_history(bus::topics::contacts, kHistory)), coupling(p, with_history(bus::topics::object_coupling, kHistory)),
          objects(p, with_history(bus::topics::objects, kHistory)), wrench(p, with_history(bus::topics::bone_wrench, kHistory)),
          device(p, with_history(bus::topics::device_state, kHistory)) {}
    bus::Reader<Skeleton> tracked;
    bus::Reader<Skeleton> simulated;
    bus::Reader<Contacts> contacts;
    bus::Reader<ObjectCoupling> coupling;
    bus::Reader<WorldObjects> objects;
    bus::Reader<BoneWrench> wrench;
    bus::Reader<DeviceState> device;
  };
  bus::Reader<LoopStatus> status_;
  bus::Reader<Message> messages_;
  TimeControl time_control_;
  std::optional<Streams> streams_;
  std::map<std::string, LoopStatus> modules_;
  Outcome outcome_;
};

std::vector<std::string> command_of(const RigProcess& process, const std::string& scene, const UpArguments& arguments) {
  const fs::path beside = fs::read_symlink("/proc/self/exe").parent_path() / process.program;
  std::vector<std::string> command{process.program.find('/') == std::string::npos ? beside.string() : process.program};
  std::istringstream words(process.arguments);
  for (std::string word; words >> word;) command.push_back(word == "{scene}" ? scene : word);
  for (const std::string& assignment : arguments.overrides) command.insert(command.end(), {"--set", assignment});
  if (!arguments.hand.empty()) command.insert(command.end(), {"--set", "hand.model=" + arguments.hand});
  return command;
}

}  // namespace

int run_up(const UpArguments& arguments) {
  RigOptions rig;
  read_toml(rig, arguments.rig);
  const std::string scene_path = (fs::path(arguments.rig).parent_path() / rig.scene).lexically_normal().string();
  std::vector<std::string> overrides = arguments.overrides;
  if (!arguments.hand.empty()) overrides.push_back("hand.model=" + arguments.hand);
  const Scene scene = read_checked_scene(scene_path, overrides);

  const StopSignal stop;
  const bus::Participant participant("softhand up");
  Listener listener(participant, !arguments.json.empty());
  Supervisor supervisor([](const std::string& name, const std::string& line) {
    fmt::print("{:>14} | {}\n", name, line);
    std::fflush(stdout);
  });

  std::size_t started_processes = 0;
  for (const RigProcess& process : rig.processes) {
    const std::vector<std::string> command = command_of(process, scene_path, arguments);
    if (process.optional && !fs::exists(command[0])) {
      fmt::print("{:>14} | left out: {} was not built\n", process.name, process.program);
      continue;
    }
    supervisor.start({process.name, command});
    ++started_processes;
    const auto give_up = Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(process.ready_timeout));
    while (!stop.requested() && listener.modules().count(process.name) == 0 && Clock::now() < give_up) {
      supervisor.poll(milliseconds(20));
      listener.poll();
    }
    if (listener.modules().count(process.name) == 0) fmt::print("{:>14} | not ready after {:g} s, going on\n", process.name, process.ready_timeout);
    if (stop.requested()) break;
  }
  if (!stop.requested()) fmt::print("{:>14} | {} is up: {} processes, scene {}. Try `softhand status`. Ctrl-C stops it.\n", "softhand", rig.name, started_processes, scene_path);
  std::fflush(stdout);

  const auto started = Clock::now();
  const auto until = started + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(arguments.seconds));
  while (!stop.requested() && (arguments.seconds <= 0 || Clock::now() < until)) {
    supervisor.poll(milliseconds(5));
    listener.poll();
  }

  nlohmann::ordered_json summary;
  if (!arguments.json.empty()) {
    summary["rig"] = arguments.rig;
    summary["scene"] = scene_path;
    summary["overrides"] = nlohmann::ordered_json::array();
    for (const AppliedOverride& o : scene.overrides) summary["overrides"].push_back({{"key", o.key}, {"before", o.before}, {"after", o.after}});
    summary["seconds"] = std::chrono::duration<double>(Clock::now() - started).count();
    for (const auto& [name, status] : listener.modules()) summary["loops"][name] = status_json(status);
    for (const RigProcess& process : rig.processes) summary["restarts"][process.name] = supervisor.restarts(process.name);
    summary.update(listener.outcome().summary(outcome_frame(scene, listener.motion_start())));
  }
  const bool clean = supervisor.stop();
  summary["clean_stop"] = clean;
  if (!arguments.json.empty()) {
    std::ofstream out(arguments.json);
    out << summary.dump(2) << "\n";
    out.flush();
    if (!out) throw std::runtime_error(arguments.json + ": cannot be written");
    fmt::print("{:>14} | summary in {}\n", "softhand", arguments.json);
  }
  return clean ? 0 : 1;
}

}  // namespace softhand
