#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <thread>

#include "bus/bus.hpp"
#include "cli/check.hpp"
#include "cli/commands.hpp"
#include "cli/module_table.hpp"
#include "cli/outcome.hpp"
#include "cli/rig.hpp"
#include "cli/rig_lock.hpp"
#include "cli/soft_outcome.hpp"
#include "cli/status_table.hpp"
#include "cli/supervisor.hpp"
#include "cli/topic_recording.hpp"
#include "cli/tracker_table.hpp"
#include "device/answer.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "runtime/exit_codes.hpp"
#include "runtime/signals.hpp"
#include "scene_file.hpp"
#include "service/rig_clock.hpp"
#include "service/time_control.hpp"

namespace softhand {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;
constexpr int kPolledHistory = 64;  // per stream, so that polling every 5 ms loses no message
constexpr std::string_view kRigModule = "rig";
constexpr milliseconds kDiscovery{500};      // after this time a process knows all others of the domain
constexpr milliseconds kStopOfHolder{5000};  // longest time for another rig to stop

// The reader of the output may be gone. The rig must run on and stop in order, so errors are ignored.
void say(std::string_view name, std::string_view text) {
  const std::string line = fmt::format("{:>14} | {}\n", name, text);
  std::fwrite(line.data(), 1, line.size(), stdout);
  std::fflush(stdout);
}

// Subscribes to the topics that a summary needs. Without a summary it subscribes to loop_status only, because modules
// do not compute topics without a subscriber.
class Listener {
 public:
  /// The hands of the scene's user are judged. Tracked hands of other users are the sources of a fusion.
  Listener(const bus::Participant& participant, bool everything, const Scene& scene)
      : user_(hand_key(scene).user), status_(participant, with_history(bus::topics::loop_status, kPolledHistory)) {
    if (!everything) return;
    streams_.emplace(participant);
    if (scene.soft_objects.empty()) return;
    soft_states_.emplace(participant, with_history(bus::topics::soft_object_state, kPolledHistory));
    soft_outcome_.emplace(*scene.soft_objects.front().body);
  }

  /// `watched` gets the signs of life of its children.
  void poll(Supervisor* watched = nullptr) {
    status_.take_all([&, at = now()](const LoopStatus& status) {
      const std::string module(get_text(status.module));
      if (module == kRigModule || module.starts_with(std::string(kRigModule) + "-")) return;
      if (LoopStatus* const known = modules_.of(module, at)) *known = status;
      if (watched != nullptr) watched->heard(module, static_cast<pid_t>(status.process_id));
    });
    if (!streams_) return;
    streams_->tracked.take_all([this](const Skeleton& m) {
      if (m.hand.user == user_) outcome_.on_tracked(m);
    });
    streams_->simulated.take_all([this](const Skeleton& m) { outcome_.on_simulated(m); });
    streams_->contacts.take_all([this](const Contacts& m) {
      outcome_.on_contacts(m);
      if (soft_outcome_) soft_outcome_->on_contacts(m);
    });
    if (soft_outcome_) soft_states_->take_all([this](const SoftObjectState& m) { soft_outcome_->on_state(m); });
    streams_->coupling.take_all([this](const ObjectCoupling& m) { outcome_.on_coupling(m); });
    streams_->objects.take_all([this](const WorldObjects& m) { outcome_.on_objects(m); });
    streams_->wrench.take_all([this](const BoneWrench& m) { outcome_.on_bone_wrench(m); });
    streams_->device.take_all([this](const DeviceState& m) { outcome_.on_device(m); });
  }
  /// The processes of `rig` are modules that always have a place.
  void expect(const RigOptions& rig) {
    std::set<std::string> names;
    for (const RigProcess& process : rig.processes) names.insert(process.name);
    modules_.expect(std::move(names));
  }
  const std::map<std::string, LoopStatus>& modules() const { return modules_.rows(); }
  std::uint64_t refused_statuses() const { return modules_.refused(); }
  /// Call it after the processes have ended. Discards their last statuses too.
  void forget_modules() {
    poll();
    modules_.clear();
  }
  const Outcome& outcome() const { return outcome_; }
  /// Null: the scene has no flexible object, or the run has no summary.
  const SoftOutcome* soft_outcome() const { return soft_outcome_ ? &*soft_outcome_ : nullptr; }
  /// Start of the motion of a tracker in `rig`, on the clock of this host; 0 = not received.
  Nanoseconds motion_start(const RigOptions& rig) const {
    for (const auto& [name, status] : modules()) {
      // A counter of another host is on another clock.
      if (std::none_of(rig.processes.begin(), rig.processes.end(), [&name](auto& each) { return each.name == name; }))
        continue;
      if (const auto start = motion_start_of(status)) return *start;
    }
    return 0;
  }

 private:
  struct Streams {
    explicit Streams(const bus::Participant& p)
        : tracked(p, with_history(bus::topics::tracked_skeleton, kPolledHistory)),
          simulated(p, with_history(bus::topics::simulated_skeleton, kPolledHistory)),
          contacts(p, with_history(bus::topics::contacts, kPolledHistory)),
          coupling(p, with_history(bus::topics::object_coupling, kPolledHistory)),
          objects(p, with_history(bus::topics::objects, kPolledHistory)),
          wrench(p, with_history(bus::topics::bone_wrench, kPolledHistory)),
          device(p, with_history(bus::topics::device_state, kPolledHistory)) {}
    bus::Reader<Skeleton> tracked;
    bus::Reader<Skeleton> simulated;
    bus::Reader<Contacts> contacts;
    bus::Reader<ObjectCoupling> coupling;
    bus::Reader<WorldObjects> objects;
    bus::Reader<BoneWrench> wrench;
    bus::Reader<DeviceState> device;
  };
  std::uint32_t user_;
  bus::Reader<LoopStatus> status_;
  std::optional<Streams> streams_;
  ModuleTable<LoopStatus> modules_;
  Outcome outcome_;
  std::optional<bus::Reader<SoftObjectState>> soft_states_;
  std::optional<SoftOutcome> soft_outcome_;
};

// Answers messages that concern the whole rig: choose another scene, or another process among those that share a name.
// It publishes what can be chosen.
class RigControl {
 public:
  RigControl(const bus::Participant& participant, const UpArguments& arguments)
      : arguments_(arguments),
        rig_(read_rig(arguments.rig)),
        module_(std::string(kRigModule) + (rig_.part.empty() ? "" : "-" + rig_.part)),
        messages_(participant, bus::topics::message),
        time_control_(find_clock(participant)),
        replies_(participant, bus::topics::message_reply),
        statuses_(participant, bus::topics::loop_status),
        choices_(participant, bus::topics::rig_choices),
        epoch_(participant.epoch()),
        clock_id_(clock_id()) {
    pass_on_clock();
    overrides_ = arguments.overrides;
    if (!arguments.hand.empty()) overrides_.push_back("hand.model=" + arguments.hand);
    if (!arguments.scene.empty()) rig_.scene = arguments.scene;
    scene_ = read_checked_scene(rig_.scene, overrides_);
    check_programs(rig_, arguments.rig);
    const fs::path folder = fs::path(rig_.scene).parent_path();
    for (const auto& entry : fs::directory_iterator(folder.empty() ? "." : folder)) {
      if (entry.path().extension() == ".toml" && !is_rig(entry.path().string()))
        scenes_.push_back(entry.path().stem().string());
    }
    std::sort(scenes_.begin(), scenes_.end());
    // A message could not name it.
    std::erase_if(scenes_, [](const std::string& each) {
      if (each.size() < sizeof(ShortText)) return false;
      say(kRigModule, "the scene " + each + " cannot be chosen; expected a name of at most 63 characters");
      return true;
    });
    const auto choices = static_cast<std::size_t>(std::count_if(
        rig_.processes.begin(), rig_.processes.end(), [](const RigProcess& each) { return !each.choice.empty(); }));
    if (scenes_.size() + choices > kMaxChoices)
      say(kRigModule, fmt::format("{} of {} choices are published", kMaxChoices, scenes_.size() + choices));
  }

  const RigOptions& rig() const { return rig_; }
  const Scene& scene() const { return scene_; }
  const std::vector<std::string>& overrides() const { return overrides_; }
  /// True once after a change that requires a restart of the processes.
  bool take_changed() { return std::exchange(changed_, false); }
  bool changed() const { return changed_; }
  /// Another rig takes the place of this one.
  bool stop_requested() const { return stop_requested_; }
  /// True if the processes must stop for any of these reasons.
  bool must_stop(const StopSignal& stop) const { return stop.requested() || stop_requested_ || changed_; }

  void poll() {
    messages_.take_all([this](const Message& message) {
      const auto steered = time_control_.answer(message, module_, now());
      if (steered) pass_on_clock();
      MessageReply reply = steered ? *steered : answer(message);
      stamp(reply.stamp, ++replied_);
      replies_.write(reply);
    });
    if (std::exchange(choices_due_, false)) publish_choices();
    if (Clock::now() < next_status_) return;
    next_status_ = Clock::now() + milliseconds(500);
    LoopStatus status;
    set_text(status.module, module_);
    status.process_id = static_cast<std::uint32_t>(getpid());
    status.input_age_ms = -1;
    stamp(status.stamp, ++published_);
    statuses_.write(status);
  }

 private:
  // Processes that start later inherit the variable.
  void pass_on_clock() const { setenv(kClockVariable, time_control_.clock().text().c_str(), 1); }

  void publish_choices() {
    RigChoices message;
    set_text(message.module, module_);
    // Processes first: they are few.
    const std::vector<RigProcess> chosen = chosen_processes(rig_);
    for (const RigProcess& process : rig_.processes) {
      const auto is_it = [&process](const RigProcess& other) {
        return other.name == process.name && other.choice == process.choice;
      };
      if (!process.choice.empty())
        offer(message, process.name, process.choice, std::any_of(chosen.begin(), chosen.end(), is_it));
    }
    const std::string running = fs::path(rig_.scene).stem().string();
    for (const std::string& each : scenes_) offer(message, "scene", each, each == running);
    stamp(message.stamp, ++offered_);
    choices_.write(message);
  }

  static void offer(RigChoices& message, const std::string& what, const std::string& choice, bool runs) {
    RigChoice each;
    set_text(each.what, what);
    set_text(each.choice, choice);
    each.running = runs ? 1 : 0;
    message.choices.push_back(each);
  }

  void stamp(Stamp& stamp, std::uint64_t sequence) const {
    stamp.sequence = sequence;
    stamp.epoch = epoch_;
    stamp.clock_id = clock_id_;
    stamp.sample_time = stamp.publish_time = now();
  }

  MessageReply answer(const Message& message) {
    const auto reply = [&](std::uint32_t result, std::string_view text) {
      return reply_to(message, module_, result, text);
    };
    if (!is_addressed(message, kRigModule) && !is_addressed(message, module_))
      return reply(kReplyIgnored, "not for this module");
    const std::string what(get_text(message.key)), choice(get_text(message.value));
    if (what == "stop") {
      if (choice != std::to_string(epoch_)) return reply(kReplyRefused, "not the number of this rig");
      stop_requested_ = true;
      return reply(kReplyApplied, "stopping, another rig takes over");
    }
    const auto is_it = [&what](const RigProcess& process) { return process.name == what && !process.choice.empty(); };
    if (what != "scene" && std::none_of(rig_.processes.begin(), rig_.processes.end(), is_it))
      return reply(kReplyIgnored, "unknown key; known: scene, and the processes that have a choice");
    if (!arguments_.json.empty()) return reply(kReplyRefused, "a run with a summary (--json) cannot be changed");
    if (what == "scene") {
      if (std::find(scenes_.begin(), scenes_.end(), choice) == scenes_.end())
        return reply(kReplyRefused, "no such scene in the folder of the present scene: " + choice);
      const std::string path = (fs::path(rig_.scene).parent_path() / (choice + ".toml")).string();
      try {
        scene_ = read_checked_scene(path, overrides_);
      } catch (const std::exception& error) {
        return reply(kReplyRefused, error.what());
      }
      rig_.scene = path;
    } else if (!choose(rig_, what, choice)) {
      return reply(kReplyRefused, "no such choice of " + what + " in the rig");
    }
    changed_ = choices_due_ = true;
    return reply(kReplyApplied, "restarting with " + what + " " + choice);
  }

  const UpArguments& arguments_;
  RigOptions rig_;
  std::string module_;  // "rig"; a part of a rig also answers to messages to "rig"
  std::vector<std::string> overrides_;
  Scene scene_;
  std::vector<std::string> scenes_;  // file names without extension in the folder of the rig's scene
  bus::Reader<Message> messages_;
  TimeControl time_control_;
  bus::Writer<MessageReply> replies_;
  bus::Writer<LoopStatus> statuses_;
  bus::Writer<RigChoices> choices_;
  Clock::time_point next_status_{};
  std::uint64_t epoch_;
  std::uint32_t clock_id_;
  std::uint64_t replied_ = 0;
  std::uint64_t published_ = 0;
  std::uint64_t offered_ = 0;
  bool changed_ = false;
  bool choices_due_ = true;
  bool stop_requested_ = false;
};

// Makes this process the only one on the domain that holds a rig, or this part of it. Returns the holder if that is
// another one. With `replace` it is asked to stop first.
std::optional<RigHolder> take_domain(RigLock& lock, const bus::Participant& participant, const RigHolder& self,
                                     bool replace, const StopSignal& stop) {
  std::optional<bus::Writer<Message>> messages;
  if (replace) messages.emplace(participant, bus::topics::message);
  std::set<std::uint64_t> asked;
  const auto ask_to_stop = [&](const bus::Peer& peer) {
    if (!asked.insert(peer.epoch).second) return;
    Message message;
    message.id = make_epoch();
    message.stamp.epoch = participant.epoch();
    message.stamp.clock_id = clock_id();
    message.stamp.sequence = asked.size();
    message.stamp.sample_time = message.stamp.publish_time = now();
    set_text(message.module, kRigModule);
    set_text(message.key, "stop");
    set_text(message.value, std::to_string(peer.epoch));
    messages->write(message);
  };
  const auto start = Clock::now();
  for (;;) {
    std::optional<RigHolder> holder = lock.take(self);
    for (const bus::Peer& peer : participant.peers()) {
      if (get_text(peer.rig).empty() || share_domain(self.rig, get_text(peer.rig))) continue;
      if (replace) ask_to_stop(peer);
      if (!holder)
        holder = RigHolder{std::string(get_text(peer.rig)), std::string(get_text(peer.host)), peer.process_id};
    }
    if (holder && (!replace || stop.requested() || Clock::now() - start > kStopOfHolder)) return holder;
    // After the end of a holder that answered on DDS, all others are known, too.
    if (!holder && (!asked.empty() || stop.requested() || Clock::now() - start > kDiscovery)) return std::nullopt;
    std::this_thread::sleep_for(milliseconds(5));
  }
}

ChildSpec child_of(const RigProcess& process, std::vector<std::string> command) {
  const StopTurn turn = process.stop == "first"  ? StopTurn::first
                        : process.stop == "last" ? StopTurn::last
                                                 : StopTurn::in_turn;
  return {process.name, std::move(command), turn, milliseconds(std::llround(1e3 * process.longest_silence))};
}

// Starts the processes of the rig in order, each when the previous one is ready. Returns early after a stop or a change
// of the rig.
void start_processes(Supervisor& supervisor, Listener& listener, RigControl& control, const StopSignal& stop) {
  std::size_t started = 0;
  for (const RigProcess& process : chosen_processes(control.rig())) {
    const std::vector<std::string> command = command_of(process, control.rig().scene, control.overrides());
    if (process.optional && !fs::exists(command[0])) {
      say(process.name, "skipped: " + process.program + " was not built");
      continue;
    }
    supervisor.start(child_of(process, command));
    ++started;
    const auto give_up = Clock::now() + std::chrono::duration_cast<Clock::duration>(
                                            std::chrono::duration<double>(process.ready_timeout));
    const auto is_ready = [&] { return listener.modules().count(process.name) > 0; };
    while (!control.must_stop(stop) && !is_ready() && !supervisor.gave_up(process.name) && Clock::now() < give_up) {
      supervisor.poll(milliseconds(20));
      listener.poll(&supervisor);
      control.poll();
    }
    if (control.must_stop(stop)) return;
    if (!is_ready() && !supervisor.gave_up(process.name))
      say(process.name, fmt::format("not ready after {:g} s; starting the next process", process.ready_timeout));
  }
  say("softhand", fmt::format("{} is up: {} processes, scene {}. Try `softhand status`. Ctrl-C stops it.",
                              full_name(control.rig()), started, control.rig().scene));
}

nlohmann::ordered_json summary_of(const UpArguments& arguments, const RigControl& control, const Listener& listener,
                                  const Supervisor& supervisor, double seconds) {
  nlohmann::ordered_json summary{
      {"rig", arguments.rig}, {"scene", control.rig().scene}, {"overrides", nlohmann::ordered_json::array()}};
  for (const AppliedOverride& o : control.scene().overrides)
    summary["overrides"].push_back({{"key", o.key}, {"before", o.before}, {"after", o.after}});
  summary["seconds"] = seconds;
  for (const auto& [name, status] : listener.modules()) summary["loops"][name] = status_json(status);
  summary["refused_statuses"] = listener.refused_statuses();
  for (const RigProcess& process : chosen_processes(control.rig()))
    summary["restarts"][process.name] = supervisor.restarts(process.name);
  const OutcomeFrame frame = outcome_frame(control.scene(), listener.motion_start(control.rig()));
  summary.update(listener.outcome().summary(frame));
  if (const SoftOutcome* soft = listener.soft_outcome()) {
    summary["soft"] = soft->summary(control.scene().options.judge.soft, frame);
    join_success(summary, "soft");
  }
  return summary;
}

}  // namespace

int run_up(const UpArguments& arguments) {
  const StopSignal stop;
  // The processes inherit the folder. Programs of others ignore the variable.
  if (!arguments.flight.empty())
    setenv("SOFTHAND_FLIGHT", fs::absolute(arguments.flight).lexically_normal().c_str(), 1);
  const RigHolder self = this_process(full_name(read_rig(arguments.rig)));
  const int domain = bus::domain_from_environment();
  RigLock lock(domain);  // released after the participant has left
  const bus::Participant participant("softhand up", domain, self.rig);
  RigControl control(participant, arguments);
  if (const auto holder = take_domain(lock, participant, self, arguments.replace, stop)) {
    fmt::print(stderr, "softhand up: domain {} is held by {}; {}\n", domain, to_text(*holder),
               arguments.replace ? "it was asked to stop and has not stopped" : "stop it, or start with --replace");
    return kExitHeld;
  }
  std::ofstream out;  // a run may take long, so a wrong path is found before it
  if (!arguments.json.empty()) out.open(arguments.json);
  if (!out) throw std::runtime_error(arguments.json + ": cannot be written");
  Listener listener(participant, !arguments.json.empty(), control.scene());
  nlohmann::ordered_json summary;
  bool clean = true;
  do {
    Supervisor supervisor(say);
    listener.expect(control.rig());
    start_processes(supervisor, listener, control, stop);
    const auto started = Clock::now();
    const std::chrono::duration<double> run_time(arguments.seconds);
    while (!control.must_stop(stop) && (arguments.seconds <= 0 || Clock::now() - started < run_time)) {
      supervisor.poll(milliseconds(5));
      listener.poll(&supervisor);
      control.poll();
    }
    if (!arguments.json.empty())
      summary = summary_of(arguments, control, listener, supervisor,
                           std::chrono::duration<double>(Clock::now() - started).count());
    clean = supervisor.stop() && !supervisor.gave_up() && clean;
    listener.forget_modules();
  } while (control.take_changed() && !stop.requested() && !control.stop_requested());
  if (!arguments.json.empty()) {
    summary["clean_stop"] = clean;
    out << json_text(summary) << "\n";
    out.flush();
    if (!out) throw std::runtime_error(arguments.json + ": cannot be written");
    say("softhand", "summary in " + arguments.json);
  }
  return clean ? 0 : 1;
}

}  // namespace softhand
