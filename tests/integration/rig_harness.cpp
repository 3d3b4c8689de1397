#include "integration/rig_harness.hpp"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "messages/convert.hpp"

extern char** environ;

namespace softhand::rig {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::size_t kMaxSamples = 20000;  // samples of a stream: some 20 s at 1 kHz

pid_t spawn(const std::vector<std::string>& command, const std::string& log) {
  std::vector<char*> argv;
  for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  pid_t pid = 0;
  const int error = posix_spawn(&pid, argv[0], &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) throw std::runtime_error("cannot start " + command[0]);
  return pid;
}

std::string new_log() {
  std::string path = "/tmp/softhand_rig_XXXXXX";
  const int file = mkstemp(path.data());
  if (file < 0) throw std::runtime_error("cannot make " + path);
  close(file);
  return path;
}

std::string text_of(const std::string& path) {
  std::ifstream in(path);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

template <typename T>
bus::Topic<T> deep(bus::Topic<T> topic) {
  if (topic.rate_hz > 0) topic.depth = 512;
  return topic;
}

template <typename T>
void append(std::deque<T>& samples, const T& sample) {
  samples.push_back(sample);
  if (samples.size() > kMaxSamples) samples.pop_front();
}

}  // namespace

Finished run_program(const std::vector<std::string>& command) {
  const std::string log = new_log();
  int status = 0;
  waitpid(spawn(command, log), &status, 0);
  Finished finished{WIFEXITED(status) ? WEXITSTATUS(status) : -1, text_of(log)};
  unlink(log.c_str());
  return finished;
}

Program::Program(const std::vector<std::string>& command) : log_(new_log()), pid_(spawn(command, log_)) {}

Program::~Program() {
  send_signal(SIGTERM);
  if (pid_ > 0 && wait(std::chrono::seconds(8)) < 0 && pid_ > 0) {
    send_signal(SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  unlink(log_.c_str());
}

void Program::send_signal(int number) const {
  if (pid_ > 0) kill(pid_, number);
}

int Program::wait(std::chrono::milliseconds timeout) {
  const auto end = Clock::now() + timeout;
  int status = 0;
  while (pid_ > 0 && waitpid(pid_, &status, WNOHANG) != pid_) {
    if (Clock::now() > end) return -1;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  pid_ = 0;
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

std::string Program::output() const { return text_of(log_); }

namespace {
std::vector<std::string> up_command(const std::string& rig, const std::vector<std::string>& arguments) {
  // The results must not depend on the hands that the user of this machine has calibrated.
  std::vector<std::string> command{SOFTHAND_PROGRAMS "/softhand", "up", SOFTHAND_SOURCE_DIR "/" + rig, "--set",
                                   "calibration=none"};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return command;
}
}  // namespace

Up::Up(const std::string& rig, const std::vector<std::string>& arguments) : Program(up_command(rig, arguments)) {}

bool is_alive(std::uint32_t process_id) {
  const std::string stat = text_of("/proc/" + std::to_string(process_id) + "/stat");
  const std::size_t name_end = stat.rfind(')');
  return name_end != std::string::npos && name_end + 2 < stat.size() && stat[name_end + 2] != 'Z';
}

RigListener::RigListener()
    : participant_("rig test"),
      status_(participant_, deep(bus::topics::loop_status)),
      tracked_(participant_, deep(bus::topics::tracked_skeleton)),
      intermediate_(participant_, deep(bus::topics::intermediate_skeleton)),
      simulated_(participant_, deep(bus::topics::simulated_skeleton)),
      contacts_(participant_, deep(bus::topics::contacts)),
      traction_(participant_, deep(bus::topics::skin_traction)),
      coupling_(participant_, deep(bus::topics::object_coupling)),
      objects_(participant_, deep(bus::topics::objects)),
      wrench_(participant_, deep(bus::topics::bone_wrench)),
      device_(participant_, deep(bus::topics::device_state)) {}

void RigListener::take_skeleton(const Skeleton& skeleton, const char* topic) {
  ++heard[topic];
  for (const JointSample& joint : skeleton.joints) {
    if ((joint.flags & kJointValid) == 0) continue;
    if (all_finite(joint.position) && all_finite(joint.orientation) && all_finite(joint.linear_velocity) &&
        all_finite(joint.angular_velocity))
      continue;
    ++nonfinite[topic];
    break;
  }
}

double RigListener::follow_error(const Skeleton& hand) const {
  const TrackedSample* nearest = nullptr;
  for (auto sample = tracked.rbegin(); sample != tracked.rend(); ++sample) {
    if (nearest != nullptr &&
        std::abs(sample->time - hand.stamp.sample_time) >= std::abs(nearest->time - hand.stamp.sample_time))
      break;
    nearest = &*sample;
  }
  if (nearest == nullptr || std::abs(nearest->time - hand.stamp.sample_time) > 50'000'000) return -1;
  double sum = 0;
  for (std::size_t j = 0; j < kJointCount; ++j)
    sum += (to_vector(hand.joints[j].position) - to_vector(nearest->joints[j])).norm();
  return sum / static_cast<double>(kJointCount);
}

void RigListener::poll() {
  status_.take_all([this](const LoopStatus& status) {
    const std::string module(get_text(status.module));
    modules[module] = status;
    ++heard["loop_status"];
    for (const NamedValue& counter : status.counters) {
      double& peak = peaks[module][std::string(get_text(counter.name))];
      peak = std::max(peak, counter.value);
    }
  });
  tracked_.take_all([this](const Skeleton& skeleton) {
    TrackedSample sample{skeleton.stamp.sample_time, skeleton.stamp.publish_time, skeleton.source, {}};
    for (std::size_t j = 0; j < kJointCount; ++j) sample.joints[j] = skeleton.joints[j].position;
    append(tracked, sample);
    ++heard["tracked_skeleton"];
  });
  intermediate_.take_all([this](const Skeleton& skeleton) { take_skeleton(skeleton, "intermediate_skeleton"); });
  simulated_.take_all([this](const Skeleton& skeleton) {
    take_skeleton(skeleton, "simulated_skeleton");
    append(simulated, HandSample{skeleton.stamp.publish_time, skeleton.stamp.epoch, skeleton.stamp.chain.tracker_sample,
                                 follow_error(skeleton),
                                 skeleton.joints[static_cast<std::size_t>(index_of(Joint::wrist))].position});
  });
  contacts_.take_all([this](const Contacts& contacts) {
    ++heard["contacts"];
    const auto finite = [](const auto& c) { return all_finite(c.force) && all_finite(c.normal); };
    if (!std::all_of(contacts.fingers.begin(), contacts.fingers.end(), finite) ||
        !std::all_of(contacts.contacts.begin(), contacts.contacts.end(), finite)) {
      ++nonfinite["contacts"];
    }
  });
  traction_.take_all([this](const SkinTraction& traction) {
    ++heard["skin_traction"];
    const auto finite = [](const SkinRegion& region) {
      const float values[] = {
          region.shear[0], region.shear[1],         region.shear[2],         region.pressure,
          region.area,     region.slip_velocity[0], region.slip_velocity[1], region.slip_velocity[2]};
      return std::all_of(std::begin(values), std::end(values), [](float x) { return std::isfinite(x); });
    };
    if (!std::all_of(traction.regions.begin(), traction.regions.end(), finite)) ++nonfinite["skin_traction"];
  });
  coupling_.take_all([this](const ObjectCoupling& coupling) {
    ++heard["object_coupling"];
    for (const ObjectTwin& twin : coupling.twins) {
      if (!all_finite(twin.position) || !all_finite(twin.orientation) || !all_finite(twin.linear_velocity) ||
          !all_finite(twin.contact_force)) {
        ++nonfinite["object_coupling"];
      }
    }
  });
  objects_.take_all([this](const WorldObjects& world) {
    ++heard["objects"];
    for (const ObjectState& object : world.objects) {
      objects[object.object] = object.position;
      if (!all_finite(object.position) || !all_finite(object.orientation) || !all_finite(object.linear_velocity))
        ++nonfinite["objects"];
    }
  });
  wrench_.take_all([this](const BoneWrench& wrench) {
    ++heard["bone_wrench"];
    for (const BoneSample& bone : wrench.bones) {
      if (!all_finite(bone.intermediate_position) || !all_finite(bone.coupling_force) ||
          !all_finite(bone.coupling_torque) || !all_finite(bone.contact_force)) {
        ++nonfinite["bone_wrench"];
        break;
      }
    }
  });
  device_.take_all([this](const DeviceState& state) {
    ++heard["device_state"];
    double largest = 0;
    for (const double command : state.commands) {
      if (!std::isfinite(command)) ++nonfinite["device_state"];
      largest = std::max(largest, std::abs(command));
    }
    append(devices[state.device], DeviceSample{state.stamp.publish_time, state.stamp.epoch, state.live != 0, largest});
  });
}

bool RigListener::wait(std::chrono::milliseconds timeout, const std::function<bool()>& done) {
  const auto end = Clock::now() + timeout;
  for (;;) {
    poll();
    if (done()) return true;
    if (Clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

double RigListener::counter(const std::string& module, const std::string& name) const {
  const auto found = modules.find(module);
  if (found == modules.end()) return std::nan("");
  for (const NamedValue& each : found->second.counters) {
    if (get_text(each.name) == name) return each.value;
  }
  return std::nan("");
}

std::int64_t RigListener::process_id(const std::string& module) const {
  const auto found = modules.find(module);
  return found == modules.end() ? -1 : static_cast<std::int64_t>(found->second.process_id);
}

bool RigListener::device_is_on(std::uint32_t device) const {
  const auto found = devices.find(device);
  return found != devices.end() && !found->second.empty() && found->second.back().live &&
         found->second.back().largest_command > 0;
}

}  // namespace softhand::rig
