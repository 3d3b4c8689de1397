// The demo with real processes: start, death of each process, two trackers, faults of a tracker, and messages. The time
// limits leave room for a busy machine. Measured times are printed.
#include <gtest/gtest.h>
#include <sched.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "integration/rig_harness.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "runtime/exit_codes.hpp"
#include "support/own_domain.hpp"

namespace softhand::rig {
namespace {

using namespace std::chrono_literals;

constexpr const char* kDemo = "config/rigs/demo.toml";
constexpr const char* kTouch = "tests/integration/rig_touch.toml";  // two fingers stay on a fixed post
const std::set<std::string> kModules{"world", "hand", "tracking", "haptic", "tactile", "tracker"};
constexpr std::uint32_t kHaptic = 1;  // device ids of the demo
constexpr std::uint32_t kTactile = 2;
constexpr double kFollows =
    0.02;  // m, mean over the joints: enough for a hand that lags, presses or holds, but follows the tracked one

// Limits for the time from a kill, ms. The promised value is 1000. These limits are for a machine that is six to nine
// times oversubscribed (load 12 to 19 on two cores). Seven runs on such a machine gave up to 980 for the other
// processes. They gave 520 to 2220 for the tracker, which solves its grip again and starts its motion again.
constexpr double kFollowsWithin = 2000;
constexpr double kFollowsTrackerWithin = 3000;

double milliseconds_between(Nanoseconds from, Nanoseconds to) { return static_cast<double>(to - from) * 1e-6; }

// The fixture sets the domain before anything opens it.
class Rig : public ::testing::Test {
 protected:
  Rig() { testing::use_own_domain(); }

  static bool all_present(const RigListener& listener) {
    return std::all_of(kModules.begin(), kModules.end(),
                       [&](const std::string& m) { return listener.process_id(m) > 0; });
  }
  /// True if the hand follows tracker samples taken after `since`, in each of the last `count` steps.
  static bool follows(const RigListener& listener, Nanoseconds since, std::size_t count = 10) {
    if (listener.simulated.size() < count) return false;
    return std::all_of(listener.simulated.end() - static_cast<std::ptrdiff_t>(count), listener.simulated.end(),
                       [&](const RigListener::HandSample& s) {
                         return s.tracker_sample > since && s.follow_error >= 0 && s.follow_error < kFollows;
                       });
  }
  static void expect_all_finite(const RigListener& listener) {
    for (const auto& [topic, count] : listener.nonfinite) EXPECT_EQ(count, 0u) << topic;
    for (const char* topic : {"simulated_skeleton", "intermediate_skeleton", "bone_wrench", "contacts",
                              "object_coupling", "objects", "device_state"}) {
      EXPECT_GT(listener.heard.count(topic) != 0 ? listener.heard.at(topic) : 0u, 0u) << topic;
    }
  }
};

TEST_F(Rig, DemoStartsFollowsAndStops) {
  RigListener listener;
  std::set<std::uint32_t> processes;
  {
    Up up(kDemo, {});
    ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
    EXPECT_TRUE(listener.wait(10s, [&] { return follows(listener, 0); }));
    EXPECT_TRUE(listener.wait(10s, [&] { return listener.device_is_on(kHaptic); }));
    EXPECT_TRUE(listener.wait(10s, [&] { return listener.device_is_on(kTactile); }));
    listener.listen(2s);  // rates are of the last second
    for (const std::string& module : kModules) {
      const LoopStatus& status = listener.modules.at(module);
      processes.insert(status.process_id);
      std::printf("%-9s %7.1f of %6.1f Hz, step p99 %6.3f ms\n", module.c_str(), status.rate_hz, status.nominal_rate_hz,
                  status.step_ms_p99);
      EXPECT_GT(status.rate_hz, 0.6 * status.nominal_rate_hz) << module;
      EXPECT_LT(status.rate_hz, 1.1 * status.nominal_rate_hz) << module;
      EXPECT_GE(status.step_ms_p999, status.step_ms_p99) << module;
    }
    // A physics loop publishes these values. Whether its ledger closes is tested on the virtual clock, where every step
    // has enough time.
    const LoopStatus& hand = listener.modules.at("hand");
    EXPECT_GT(hand.iterations, 0u);
    EXPECT_GT(hand.coupling_stretch, 0);
    EXPECT_GT(hand.energies.size(), 5u);
    EXPECT_GT(hand.ledger.size(), 5u);
    EXPECT_GT(listener.modules.at("tracking").ledger.size(), 5u);
    EXPECT_NE(listener.modules.at("haptic").passivity_energy, 0);
    EXPECT_EQ(processes.size(), kModules.size());
    for (const std::uint32_t process : processes) EXPECT_TRUE(is_alive(process));
    expect_all_finite(listener);
    up.send_signal(SIGINT);
    EXPECT_EQ(up.wait(8s), 0) << "not a clean stop:\n" << up.output();
  }
  for (const std::uint32_t process : processes) EXPECT_FALSE(is_alive(process)) << "orphan " << process;
  // On exit, devices are left at zero.
  for (const std::uint32_t device : {kHaptic, kTactile}) {
    EXPECT_TRUE(listener.wait(1s, [&] { return !listener.devices[device].back().live; })) << device;
    EXPECT_EQ(listener.devices[device].back().largest_command, 0) << device;
  }
}

// Sets the folder of the lock of the programs that are started later.
class RuntimeFolder {
 public:
  RuntimeFolder() : path_("/tmp/softhand_rig_runtime_" + std::to_string(getpid())) {
    std::filesystem::create_directories(path_);
    setenv("XDG_RUNTIME_DIR", path_.c_str(), 1);
  }
  ~RuntimeFolder() {
    if (before_.empty()) {
      unsetenv("XDG_RUNTIME_DIR");
    } else {
      setenv("XDG_RUNTIME_DIR", before_.c_str(), 1);
    }
    std::filesystem::remove_all(path_);
  }
  RuntimeFolder(const RuntimeFolder&) = delete;
  RuntimeFolder& operator=(const RuntimeFolder&) = delete;

 private:
  std::string path_;
  std::string before_ = std::getenv("XDG_RUNTIME_DIR") == nullptr ? "" : std::getenv("XDG_RUNTIME_DIR");
};

// Seen by the file lock. A rig of another user or host has another file, and is seen on DDS.
TEST_F(Rig, ASecondRigNamesTheFirstAndEnds) {
  RigListener listener;
  Up up(kDemo, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  const std::string holder = "is held by rig demo (process " + std::to_string(up.process_id()) + " on ";
  const auto second = [&] {
    const auto start = now();
    const Finished finished =
        run_program({SOFTHAND_PROGRAMS "/softhand", "up", std::string(SOFTHAND_SOURCE_DIR "/") + kDemo});
    std::printf("the second rig ended after %.0f ms\n", milliseconds_between(start, now()));
    return finished;
  };
  const auto processes = [&] {
    std::map<std::string, std::int64_t> ids;
    for (const std::string& module : kModules) ids[module] = listener.process_id(module);
    return ids;
  };
  const auto before = processes();
  const Finished same_user = second();
  EXPECT_EQ(same_user.exit_code, kExitHeld) << same_user.output;
  EXPECT_NE(same_user.output.find(holder), std::string::npos) << same_user.output;
  const RuntimeFolder other_folder;
  const Finished other_user = second();
  EXPECT_EQ(other_user.exit_code, kExitHeld) << other_user.output;
  EXPECT_NE(other_user.output.find(holder), std::string::npos) << other_user.output;
  const Nanoseconds since = now();
  EXPECT_TRUE(listener.wait(10s, [&] { return follows(listener, since); })) << "the first rig was disturbed";
  EXPECT_EQ(processes(), before);
}

TEST_F(Rig, ReplaceTakesTheDomainOver) {
  for (const bool is_other_user : {false, true}) {
    RigListener listener;
    Up first(kDemo, {});
    ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << first.output();
    const std::int64_t hand = listener.process_id("hand");
    std::optional<RuntimeFolder> other_folder;
    if (is_other_user) other_folder.emplace();
    const Nanoseconds start = now();
    Up second(kDemo, {"--replace"});
    EXPECT_EQ(first.wait(8s), 0) << "the first rig stops cleanly\n" << first.output() << second.output();
    const double took = milliseconds_between(start, now());
    std::printf("the first rig gave way %.0f ms after the start of the second\n", took);
    EXPECT_LT(took, 2500) << "1 s on a machine that does nothing else";
    EXPECT_TRUE(listener.wait(20s, [&] {
      return listener.process_id("hand") != hand && follows(listener, start + 3'000'000'000);
    })) << second.output();
    second.send_signal(SIGINT);
    EXPECT_EQ(second.wait(8s), 0);
  }
}

TEST_F(Rig, ReplaceWithoutAnotherRigStarts) {
  const RuntimeFolder own_folder;
  RigListener listener;
  Up up(kDemo, {"--replace"});
  EXPECT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
}

TEST_F(Rig, ChildrenDieWithTheirSupervisor) {
  RigListener listener;
  Up up(kDemo, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  up.send_signal(SIGKILL);
  EXPECT_TRUE(listener.wait(5s, [&] {
    return std::none_of(listener.modules.begin(), listener.modules.end(),
                        [](const auto& each) { return is_alive(each.second.process_id); });
  }));
}

// A stopped process is alive for the kernel, but it does not report. Its status ends, so it is replaced.
TEST_F(Rig, AProcessThatHangsIsReplaced) {
  RigListener listener;
  Up up(kDemo, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  for (const char* module : {"haptic", "hand"}) {
    const std::int64_t hung = listener.process_id(module);
    const Nanoseconds since = now();
    ASSERT_EQ(kill(static_cast<pid_t>(hung), SIGSTOP), 0);
    EXPECT_TRUE(listener.wait(15s, [&] { return listener.process_id(module) != hung; })) << module << up.output();
    EXPECT_FALSE(is_alive(static_cast<std::uint32_t>(hung))) << module;
    std::printf("%s replaced after %.1f s\n", module, 1e-3 * milliseconds_between(since, now()));
  }
  const Nanoseconds replaced = now();
  EXPECT_TRUE(listener.wait(10s, [&] { return follows(listener, replaced); }));
  EXPECT_NE(up.output().find("hand | no status for"), std::string::npos) << up.output();
}

struct Thread {
  pid_t id;
  std::string name;
  int policy;
  int priority;
};
std::vector<Thread> threads_of(std::int64_t process) {
  std::vector<Thread> threads;
  for (const auto& task : std::filesystem::directory_iterator("/proc/" + std::to_string(process) + "/task")) {
    Thread thread{std::stoi(task.path().filename().string()), "", 0, 0};
    std::ifstream(task.path() / "comm") >> thread.name;
    thread.policy = sched_getscheduler(thread.id) & ~SCHED_RESET_ON_FORK;
    sched_param parameters{};
    sched_getparam(thread.id, &parameters);
    thread.priority = parameters.sched_priority;
    threads.push_back(thread);
  }
  return threads;
}
bool may_raise_priority() {
  sched_param before{};
  const int policy = sched_getscheduler(0);
  sched_getparam(0, &before);
  const sched_param raised{.sched_priority = 1};
  if (sched_setscheduler(0, SCHED_FIFO, &raised) != 0) return false;
  sched_setscheduler(0, policy, &before);
  return true;
}

// Network and files must never hold up a step of any process.
TEST_F(Rig, OnlyLoopsRunAtARaisedPriority) {
  if (!may_raise_priority()) GTEST_SKIP() << "no permission for real-time priority";
  const std::string log = "/tmp/softhand_rig_glove_" + std::to_string(getpid()) + ".jsonl";
  RigListener listener;
  // With a web server, datagrams, a log file and flight recorders.
  Up up("config/rigs/landmarks.toml",
        {"--set", "tracker_landmarks.port=0", "--set", "viewer.port=0", "--set", "haptic.log.file=" + log});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  listener.listen(1s);
  const std::map<std::string, int> priorities{{"haptic", 30},   {"tactile", 30}, {"tracker", 30},
                                              {"tracking", 30}, {"world", 25},   {"hand", 20}};
  for (const auto& [module, priority] : priorities) {
    const std::int64_t process = listener.process_id(module);
    const std::vector<Thread> threads = threads_of(process);
    EXPECT_GT(threads.size(), 3u) << module << ": DDS has threads of its own";
    for (const Thread& thread : threads) {
      const bool computes = thread.id == process || thread.name == "helper";
      EXPECT_EQ(thread.policy, computes ? SCHED_FIFO : SCHED_OTHER) << module << " thread " << thread.name;
      EXPECT_EQ(thread.priority, computes ? priority : 0) << module << " thread " << thread.name;
    }
  }
  unlink(log.c_str());
}

TEST_F(Rig, PriorityAndCoresOfALoopAreOptions) {
  if (!may_raise_priority()) GTEST_SKIP() << "no permission for real-time priority";
  cpu_set_t allowed;
  sched_getaffinity(0, sizeof allowed, &allowed);
  if (CPU_COUNT(&allowed) < 2 || !CPU_ISSET(0, &allowed)) GTEST_SKIP() << "one core";
  RigListener listener;
  Up up("tests/integration/rig_cores.toml", {});
  ASSERT_TRUE(listener.wait(20s, [&] { return listener.process_id("world") > 0; })) << up.output();
  const std::int64_t process = listener.process_id("world");
  int elsewhere = 0;
  for (const Thread& thread : threads_of(process)) {
    cpu_set_t cores;
    sched_getaffinity(thread.id, sizeof cores, &cores);
    if (thread.id != process) {
      elsewhere += CPU_COUNT(&cores) > 1 ? 1 : 0;
      continue;
    }
    EXPECT_EQ(thread.policy, SCHED_FIFO);
    EXPECT_EQ(thread.priority, 7);
    EXPECT_TRUE(CPU_COUNT(&cores) == 1 && CPU_ISSET(0, &cores));
  }
  EXPECT_GT(elsewhere, 3) << "input and output may use all cores";
}

// A configuration error does not go away by itself.
TEST_F(Rig, AProcessWithAWrongConfigurationIsNotRestarted) {
  const std::string path = "/tmp/softhand_rig_wrong_" + std::to_string(getpid()) + ".toml";
  std::ofstream(path) << "name = \"wrong\"\nscene = \"" SOFTHAND_SOURCE_DIR "/config/scenes/pinch.toml\"\n"
                      << "[[process]]\nname = \"world\"\nprogram = \"softhand-world\"\n"
                      << "arguments = \"--config {scene} --module world\"\n"
                      << "[[process]]\nname = \"tracking\"\nprogram = \"softhand-tracking\"\n"
                      << "arguments = \"--config {scene} --set tracking.rate=5\"\n"
                      << "[[process]]\nname = \"hand\"\nprogram = \"softhand-hand\"\n"
                      << "arguments = \"--config {scene} --no-such-option\"\n";
  const auto started = std::chrono::steady_clock::now();
  const Finished up = run_program({SOFTHAND_PROGRAMS "/softhand", "up", path, "--seconds", "2"});
  const auto took = std::chrono::steady_clock::now() - started;
  unlink(path.c_str());
  EXPECT_NE(up.exit_code, 0);
  EXPECT_EQ(up.output.find("restarts in"), std::string::npos) << up.output;
  EXPECT_NE(up.output.find("tracking | its configuration is wrong (exit code 78); not restarted"), std::string::npos)
      << up.output;
  EXPECT_NE(up.output.find("hand | its configuration is wrong (exit code 78); not restarted"), std::string::npos)
      << up.output;
  EXPECT_LT(took, 10s) << "nobody waits for the status of a process that will not come";
}

TEST_F(Rig, SummaryHasLoopsAndMotionToForce) {
  const std::string path = "/tmp/softhand_rig_summary_" + std::to_string(getpid()) + ".json";
  const Finished up = run_program({SOFTHAND_PROGRAMS "/softhand", "up", std::string(SOFTHAND_SOURCE_DIR "/") + kDemo,
                                   "--seconds", "8", "--json", path});
  EXPECT_EQ(up.exit_code, 0) << up.output;
  std::ifstream in(path);
  const nlohmann::json summary = nlohmann::json::parse(in, nullptr, false);
  unlink(path.c_str());
  ASSERT_TRUE(summary.is_object()) << up.output;
  for (const std::string& module : kModules) {
    ASSERT_TRUE(summary["loops"].contains(module)) << module;
    EXPECT_GT(summary["loops"][module]["steps"].get<double>(), 100) << module;
    EXPECT_EQ(summary["restarts"][module].get<int>(), 0) << module << "\n" << up.output;
  }
  for (const char* key : {"motion_to_force_ms_p50", "motion_to_force_ms_p99"}) {
    ASSERT_TRUE(summary.contains(key) && summary[key].is_object()) << key;
    EXPECT_GT(summary[key]["total"].get<double>(), 1) << key;
    EXPECT_LT(summary[key]["total"].get<double>(), 500) << key;
    for (const char* hop : {"tracker", "tracking", "hand", "wrench", "device"})
      EXPECT_TRUE(summary[key]["hops"].contains(hop)) << hop;
    std::printf("%s %.1f\n", key, summary[key]["total"].get<double>());
  }
  EXPECT_EQ(summary["nonfinite_published"].get<int>(), 0);
  EXPECT_TRUE(summary["clean_stop"].get<bool>());
}

// The effect of each death on the devices. If the input of a device dies, the device's own stale timer zeroes it.
struct Death {
  const char* module;
  std::vector<std::uint32_t> zeroed;  // devices
};
void PrintTo(const Death& death, std::ostream* out) { *out << death.module; }

class RigDeath : public Rig, public ::testing::WithParamInterface<Death> {};

TEST_P(RigDeath, OthersLiveDevicesAreZeroedAndTheHandFollowsAfterARestart) {
  const std::string victim = GetParam().module;
  RigListener listener;
  Up up(kTouch, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  listener.listen(2s);  // until the fingers have closed
  ASSERT_TRUE(listener.wait(
      10s, [&] { return follows(listener, 0) && listener.device_is_on(kHaptic) && listener.device_is_on(kTactile); }))
      << "follow error " << listener.simulated.back().follow_error;
  std::map<std::string, std::int64_t> before;
  for (const std::string& module : kModules) before[module] = listener.process_id(module);
  const std::uint64_t hand_epoch = listener.simulated.back().epoch;

  const Nanoseconds killed = now();
  ASSERT_EQ(kill(static_cast<pid_t>(before[victim]), SIGKILL), 0);

  // A device whose input lives is not disturbed. A device whose input died goes to zero and stays there until its input
  // is back.
  listener.listen(60ms);
  for (const std::uint32_t device : {kHaptic, kTactile}) {
    const bool itself = (victim == "haptic" && device == kHaptic) || (victim == "tactile" && device == kTactile);
    if (itself) continue;
    const bool should_zero = std::count(GetParam().zeroed.begin(), GetParam().zeroed.end(), device) != 0;
    const auto first_zero = [&]() -> const RigListener::DeviceSample* {
      for (const auto& sample : listener.devices[device]) {
        if (sample.time > killed && !sample.live) return &sample;
      }
      return nullptr;
    };
    if (should_zero) {
      ASSERT_TRUE(listener.wait(2s, [&] { return first_zero() != nullptr; }))
          << "device " << device << " was never zeroed";
      const double milliseconds = milliseconds_between(killed, first_zero()->time);
      EXPECT_EQ(first_zero()->largest_command, 0);
      EXPECT_LT(milliseconds, 150) << "device " << device;
      std::printf("%s killed: device %u zero after %.1f ms\n", victim.c_str(), device, milliseconds);
    } else {
      EXPECT_EQ(first_zero(), nullptr) << "device " << device << " was zeroed although its input lives";
    }
  }

  ASSERT_TRUE(listener.wait(5s, [&] { return listener.process_id(victim) != before[victim]; })) << "not restarted\n"
                                                                                                << up.output();
  const Nanoseconds restarted = now();
  const auto works_again = [&] {
    if (!follows(listener, killed)) return false;
    if (victim == "hand" && listener.simulated.back().epoch == hand_epoch) return false;
    return true;
  };
  EXPECT_TRUE(listener.wait(10s, works_again)) << "follow error " << listener.simulated.back().follow_error;
  const double followed =
      milliseconds_between(killed, (listener.simulated.end() - 10)->time);  // the first of those that `follows` saw
  EXPECT_LT(followed, victim == "tracker" ? kFollowsTrackerWithin : kFollowsWithin);
  std::printf("%s killed: the hand follows again within %.0f ms\n", victim.c_str(), followed);
  for (const std::uint32_t device : {kHaptic, kTactile}) {
    ASSERT_TRUE(listener.wait(
        10s, [&] { return listener.device_is_on(device) && listener.devices[device].back().time > restarted; }))
        << "device " << device;
    // From this sample on the device stays live. It follows the last sample that was not live, or it is the first
    // sample of a new process.
    const auto& samples = listener.devices[device];
    auto on = samples.end() - 1;
    while (on != samples.begin() && (on - 1)->live && (on - 1)->epoch == on->epoch && (on - 1)->time > killed) --on;
    const double back = milliseconds_between(killed, on->time);
    EXPECT_LT(back, 3000) << "device " << device;
    std::printf("%s killed: device %u commands on or again after %.0f ms\n", victim.c_str(), device, back);
  }
  const Nanoseconds status_after = now();
  EXPECT_TRUE(listener.wait(5s, [&] {
    return std::all_of(kModules.begin(), kModules.end(),
                       [&](const std::string& m) { return listener.modules.at(m).stamp.publish_time > status_after; });
  }));
  for (const std::string& module : kModules) {
    if (module == victim) continue;
    EXPECT_EQ(listener.process_id(module), before[module]) << module << " died too\n" << up.output();
  }
  expect_all_finite(listener);
}

INSTANTIATE_TEST_SUITE_P(Of, RigDeath,
                         ::testing::Values(Death{"world", {}}, Death{"hand", {kHaptic, kTactile}},
                                           Death{"tracking", {kHaptic}}, Death{"tracker", {}}, Death{"haptic", {}},
                                           Death{"tactile", {}}),
                         [](const auto& death) { return std::string(death.param.module); });

TEST_F(Rig, StrongerTrackerOwnsTheHandUntilItDies) {
  RigListener listener;
  Up up("tests/integration/rig_two_trackers.toml", {});
  const auto owner = [&] { return listener.tracked.empty() ? 0u : listener.tracked.back().source; };
  ASSERT_TRUE(listener.wait(20s, [&] {
    return listener.process_id("weak") > 0 && listener.process_id("strong") > 0 && owner() == 2;
  })) << up.output();
  listener.listen(500ms);  // the change itself is not tested
  const Nanoseconds settled = now();
  listener.listen(2s);
  const auto since = [&](Nanoseconds time, std::uint32_t source) {
    return std::count_if(listener.tracked.begin(), listener.tracked.end(),
                         [&](const auto& s) { return s.published > time && s.source == source; });
  };
  EXPECT_GT(since(settled, 2), 100);
  EXPECT_EQ(since(settled, 1), 0) << "the weaker tracker was heard although the stronger one lives";
  EXPECT_GT(listener.counter("weak", "published"), 100)
      << "the weaker tracker did not publish: this test shows nothing";

  const Nanoseconds killed = now();
  ASSERT_EQ(kill(static_cast<pid_t>(listener.process_id("strong")), SIGKILL), 0);
  ASSERT_TRUE(listener.wait(5s, [&] { return since(killed, 1) > 0; })) << "no tracker took the hand over";
  const auto taken = std::find_if(listener.tracked.begin(), listener.tracked.end(),
                                  [&](const auto& s) { return s.published > killed && s.source == 1; });
  std::printf("handed over after %.1f ms\n", milliseconds_between(killed, taken->published));
  EXPECT_LT(milliseconds_between(killed, taken->published), 300);
  EXPECT_TRUE(listener.wait(5s, [&] { return follows(listener, killed); }));
  EXPECT_TRUE(listener.wait(10s, [&] { return owner() == 2; })) << "the restarted tracker did not get the hand back";
}

TEST_F(Rig, HeldCubeSurvivesTheHandoverBetweenTrackers) {
  constexpr std::uint32_t kCube = 2;
  constexpr double kHoldBegins = 5.3;  // s of the motion
  // The approach is long. So the hand's service is up before the stronger tracker, which is started first, closes the
  // fingers.
  const std::vector<std::string> hold{"--set", "generator.hold_time=60", "--set", "generator.approach_time=3"};
  RigListener listener;
  // The stronger tracker is not part of the rig. So nobody restarts this tracker. A restarted tracker would begin its
  // motion again and own the hand.
  std::vector<std::string> command{SOFTHAND_PROGRAMS "/softhand-tracker-replay",
                                   "--config",
                                   SOFTHAND_SOURCE_DIR "/config/scenes/pinch.toml",
                                   "--module",
                                   "strong",
                                   "--strength",
                                   "5",
                                   "--source",
                                   "2"};
  command.insert(command.end(), hold.begin(), hold.end());
  Program strong(command);
  Up up(kDemo, hold);
  const auto owner = [&] { return listener.tracked.empty() ? 0u : listener.tracked.back().source; };
  const auto holds_since = [&](const char* module) {
    const double start = listener.counter(module, "motion_start_s");
    return start > 0 ? static_cast<double>(now()) * 1e-9 - start - kHoldBegins
                     : -1.0;  // the start is NaN before it is known, and NaN is not > 0
  };
  ASSERT_TRUE(listener.wait(30s, [&] {
    return all_present(listener) && holds_since("tracker") > 1 && holds_since("strong") > 1;
  })) << up.output();
  ASSERT_EQ(owner(), 2u);
  ASSERT_GT(listener.objects[kCube][1], 0.14) << "the cube was not lifted: this test shows nothing";

  strong.send_signal(SIGKILL);
  ASSERT_TRUE(listener.wait(5s, [&] { return owner() != 2; }));
  double lowest = listener.objects[kCube][1], highest = lowest;
  listener.wait(3s, [&] {
    lowest = std::min(lowest, listener.objects[kCube][1]);
    highest = std::max(highest, listener.objects[kCube][1]);
    return false;
  });
  std::printf("the cube moved by %.2f mm in height during the handover and 3 s after it\n", (highest - lowest) * 1e3);
  EXPECT_GT(lowest, 0.14);
  EXPECT_LT(highest - lowest, 3e-3);
}

// A held cube while its hand goes from one tracker to another and back: by hand, by silence, by doubt, by SIGTERM and
// by SIGKILL. The trackers differ by 2 mm, as trackers do.
TEST_F(Rig, HeldCubeSurvivesEverySwapOfTrackers) {
  constexpr std::uint32_t kCube = 2, kOther = 0, kStrong = 2;  // kOther, kStrong: sources
  const std::vector<std::string> hold{"--set", "generator.hold_time=600",       "--set", "generator.approach_time=8",
                                      "--set", "hand.model=right_400.hand.json"};
  RigListener listener;
  std::optional<Program> strong;
  const auto start_strong = [&](const char* strength, const std::vector<std::string>& settings) {
    std::vector<std::string> command{SOFTHAND_PROGRAMS "/softhand-tracker-replay",
                                     "--config",
                                     SOFTHAND_SOURCE_DIR "/config/scenes/pinch.toml",
                                     "--module",
                                     "strong",
                                     "--strength",
                                     strength,
                                     "--source",
                                     "2",
                                     "--set",
                                     "tracker.teleport_at=12",
                                     "--set",
                                     "tracker.teleport_time=3600",
                                     "--set",
                                     "tracker.teleport_offset=[0.002,0,0]"};
    command.insert(command.end(), hold.begin(), hold.end());
    for (const std::string& setting : settings) {
      command.emplace_back("--set");
      command.push_back(setting);
    }
    strong.emplace(command);
  };
  start_strong("5", {"tracker.freeze_at=34", "tracker.freeze_time=2", "tracker.doubt_at=42", "tracker.doubt_time=2"});
  Up up(kDemo, hold);
  const auto motion_time = [&](const char* module) {
    const double start = listener.counter(module, "motion_start_s");
    return start > 0 ? static_cast<double>(now()) * 1e-9 - start : -1.0;
  };
  const auto owner = [&] { return listener.tracked.empty() ? 99u : listener.tracked.back().source; };
  ASSERT_TRUE(listener.wait(40s, [&] {
    return all_present(listener) && motion_time("tracker") > 14 && motion_time("strong") > 14 && owner() == kStrong;
  })) << up.output();
  ASSERT_GT(listener.objects[kCube][1], 0.14) << "the cube was not lifted: this test shows nothing";

  // Waits for the owner. Measures how far the cube moves from where it was 0.2 s before the swap, until 1 s after it.
  int swaps = 0;
  const auto swap = [&](const char* way, std::uint32_t to, const std::function<void()>& cause) {
    std::deque<std::pair<Nanoseconds, Vec3>> path;
    const auto follow = [&] {
      path.emplace_back(now(), listener.objects[kCube]);
      return false;
    };
    listener.wait(500ms, follow);
    const double swapped = listener.counter("tracking", "swapped");
    cause();
    EXPECT_TRUE(listener.wait(20s, [&] { return follow() || owner() == to; })) << way;
    const Nanoseconds since = now() - 200'000'000;
    listener.wait(1s, follow);
    while (path.front().first < since && path.size() > 1) path.pop_front();
    const Vec3 before = path.front().second;
    double farthest = 0;
    for (const auto& [time, at] : path)
      farthest = std::max(farthest, std::hypot(at[0] - before[0], at[1] - before[1], at[2] - before[2]));
    // On a busy machine processes stall, a tracker may be silent for 50 ms, and the hand goes to and fro. 12 mm were
    // seen at a load of 14. On the virtual clock the limit is 5 mm (grasp_test.cpp).
    std::printf("%s to %s: the cube moved by %.2f mm, %.0f swaps\n", way, to == kStrong ? "strong" : "other",
                farthest * 1e3, listener.counter("tracking", "swapped") - swapped);
    EXPECT_LT(farthest, 0.015) << way;
    EXPECT_GT(listener.objects[kCube][1], 0.14) << way << ": dropped";
    swaps += owner() == to ? 1 : 0;
  };
  for (const auto& [module, to] : {std::pair("tracker", kOther), std::pair("strong", kStrong)}) {
    std::optional<Program> command;
    swap("by hand", to, [&, name = module] {
      command.emplace(std::vector<std::string>{SOFTHAND_PROGRAMS "/softhand", "trackers", "use", name});
    });
    EXPECT_EQ(command->wait(10s), 0) << command->output();
  }
  swap("silence", kOther, [] {});
  swap("silence", kStrong, [] {});
  swap("doubt", kOther, [] {});
  swap("doubt", kStrong, [] {});
  for (const auto& [way, signal] : {std::pair("SIGTERM", SIGTERM), std::pair("SIGKILL", SIGKILL)}) {
    swap(way, kOther, [&, number = signal] { strong->send_signal(number); });
    swap(way, kStrong, [&] { start_strong("50", {"tracker.start_time=20"}); });
  }
  EXPECT_EQ(swaps, 10);
}

TEST_F(Rig, FaultsOfATrackerAreRefusedOrAbsorbedAndCounted) {
  RigListener listener;
  // One motion has all three faults.
  // - The hand is 10 m away from 2 s to 3 s.
  // - One bone is NaN from 4 s to 4.5 s.
  // - No samples come from 5.5 s to 7.5 s.
  Up up(kDemo, {"--set", "generator.motion=free_motion", "--set", "generator.object_position=[0,0.5,0]", "--set",
                "generator.free_time=3600", "--set", "tracker.teleport_at=2", "--set", "tracker.teleport_time=1",
                "--set", "tracker.nan_at=4", "--set", "tracker.nan_time=0.5", "--set", "tracker.freeze_at=5.5", "--set",
                "tracker.freeze_time=2"});
  ASSERT_TRUE(listener.wait(20s, [&] {
    return all_present(listener) && listener.counter("tracker", "motion_start_s") > 0;
  })) << up.output();
  const Nanoseconds start = static_cast<Nanoseconds>(listener.counter("tracker", "motion_start_s") * 1e9);
  const auto motion_time = [&](Nanoseconds time) { return static_cast<double>(time - start) * 1e-9; };
  double largest_step_age = 0;
  ASSERT_TRUE(listener.wait(20s, [&] {
    if (const auto found = listener.modules.find("tracking"); found != listener.modules.end())
      largest_step_age = std::max(largest_step_age, found->second.input_age_ms);
    return motion_time(now()) > 9;
  }));

  // The teleport is counted twice, there and back. The simulated hand jumps along and comes back.
  EXPECT_EQ(listener.counter("tracking", "repositioned"), 2);
  EXPECT_GE(listener.counter("hand", "repositioned"), 2);
  double farthest = 0;
  for (const auto& sample : listener.simulated) farthest = std::max(farthest, std::abs(sample.wrist[0]));
  EXPECT_NEAR(farthest, 10, 1);
  // The bone with NaN is refused for half a second at 90 Hz, and its place is inferred. The rest of the hand goes on.
  EXPECT_NEAR(listener.counter("tracking", "refused_nonfinite"), 45, 15);
  EXPECT_GT(listener.counter("tracking", "inferred"), 0);
  // The freeze is reported as stale, and then as over.
  EXPECT_EQ(listener.peaks["tracking"]["stale"], 1);
  EXPECT_EQ(listener.counter("tracking", "stale"), 0);
  EXPECT_GT(largest_step_age, 1500);
  // During the freeze the simulated hand stays where it is: no drift, no drop.
  Vec3 frozen{};
  double drift = 0;
  bool any = false;
  for (const auto& sample : listener.simulated) {
    if (motion_time(sample.time) < 6.2 || motion_time(sample.time) > 7.4) continue;
    if (!any) frozen = sample.wrist;
    any = true;
    drift = std::max(drift, (to_vector(sample.wrist) - to_vector(frozen)).norm());
  }
  EXPECT_TRUE(any);
  EXPECT_LT(drift, 0.002);
  EXPECT_TRUE(listener.wait(5s, [&] { return follows(listener, start + 8'000'000'000); }))
      << listener.simulated.back().follow_error;
  std::printf("drift while frozen %.3f mm, follow error at the end %.1f mm\n", drift * 1e3,
              listener.simulated.back().follow_error * 1e3);
  expect_all_finite(listener);
  for (const std::string& module : kModules) EXPECT_TRUE(is_alive(listener.modules.at(module).process_id)) << module;
}

TEST_F(Rig, EveryModuleAnswersEveryMessage) {
  RigListener listener;
  Up up(kTouch, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  ASSERT_TRUE(listener.wait(15s, [&] { return listener.device_is_on(kHaptic) && listener.device_is_on(kTactile); }));
  const auto send = [](const std::string& module, const std::string& key, const std::string& value) {
    return run_program({SOFTHAND_PROGRAMS "/softhand", "send", module, key, value});
  };
  /// Module -> result, from the output of `softhand send`.
  const auto answers = [](const Finished& sent) {
    std::map<std::string, std::string> results;
    std::istringstream lines(sent.output);
    for (std::string line; std::getline(lines, line);) {
      std::istringstream words(line);
      std::string module, result;
      if (words >> module >> result && kModules.count(module) != 0) results[module] = result;
    }
    return results;
  };
  const auto expect_from_all = [&](const Finished& sent) {
    const auto results = answers(sent);
    for (const std::string& module : kModules)
      EXPECT_EQ(results.count(module), 1u) << module << " did not answer:\n" << sent.output;
    return results;
  };

  const Finished off = send("*", "motors", "off");
  auto results = expect_from_all(off);
  EXPECT_EQ(off.exit_code, 0);
  for (const std::string& module : kModules)
    EXPECT_EQ(results[module], module == "haptic" || module == "tactile" ? "applied" : "not") << module;
  listener.listen(100ms);
  const Nanoseconds switched_off = now();
  listener.listen(1s);
  for (const std::uint32_t device : {kHaptic, kTactile}) {
    int samples = 0;
    for (const auto& sample : listener.devices[device]) {
      if (sample.time < switched_off) continue;
      ++samples;
      ASSERT_EQ(sample.largest_command, 0) << "device " << device << " commands with its motors off";
    }
    EXPECT_GT(samples, 100);
  }

  results = expect_from_all(send("haptic", "motors", "on"));
  EXPECT_EQ(results["haptic"], "applied");
  EXPECT_EQ(results["tactile"], "not");
  EXPECT_TRUE(listener.wait(15s, [&] { return listener.device_is_on(kHaptic); }));

  const Finished refused = send("haptic", "gain", "2");
  EXPECT_EQ(answers(refused)["haptic"], "REFUSED") << refused.output;
  EXPECT_EQ(refused.exit_code, 1);
}

// The helper and the thread that it helps are bound to one core each, with the same scheduling policy. The threads of
// DDS have this policy too, but they may use every core. With one core there is no helper, and no thread is bound.
TEST_F(Rig, TwoThreadsOfTheHandBindOnlyThemselvesToCores) {
  cpu_set_t usable;
  ASSERT_EQ(sched_getaffinity(0, sizeof usable, &usable), 0);
  RigListener listener;
  Up up(kDemo, {"--set", "hand.simulation.threads=2"});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  int bound = 0;
  std::set<int> policies;
  for (const auto& task :
       std::filesystem::directory_iterator("/proc/" + std::to_string(listener.process_id("hand")) + "/task")) {
    const int thread = std::stoi(task.path().filename().string());
    cpu_set_t cores;
    if (sched_getaffinity(thread, sizeof cores, &cores) != 0 || CPU_COUNT(&cores) == CPU_COUNT(&usable)) continue;
    ++bound;
    policies.insert(sched_getscheduler(thread));
  }
  EXPECT_EQ(bound, CPU_COUNT(&usable) > 1 ? 2 : 0);
  EXPECT_LE(policies.size(), 1u);
}

TEST_F(Rig, FollowsATrackerThatRestartsItsMotionAtOnce) {
  RigListener listener;
  Up up(kDemo, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener) && follows(listener, 0); })) << up.output();
  listener.listen(3s);  // earlier, samples of the new motion were refused for as long as the old motion had run
  const double refused = listener.counter("tracking", "refused_order");
  ASSERT_EQ(run_program({SOFTHAND_PROGRAMS "/softhand", "send", "tracker", "restart", "now"}).exit_code, 0);
  const Nanoseconds sent = now();
  EXPECT_TRUE(listener.wait(1500ms, [&] { return follows(listener, sent); }));
  listener.listen(300ms);
  EXPECT_LE(listener.counter("tracking", "refused_order"), refused + 2);
}

TEST_F(Rig, SendsSurfacesOnlyWhileSomebodyReadsThem) {
  RigListener listener;
  Up up(kDemo, {});
  ASSERT_TRUE(listener.wait(20s, [&] { return all_present(listener); })) << up.output();
  ASSERT_TRUE(listener.wait(10s, [&] { return follows(listener, 0); }));
  listener.listen(500ms);
  EXPECT_EQ(listener.counter("hand", "surfaces_sent"), 0) << "nobody reads tissue_surface";
  {
    const bus::Participant participant("viewer");
    bus::Reader<TissueSurface> surfaces(participant, bus::topics::tissue_surface);
    std::size_t heard = 0;
    auto surface = std::make_unique<TissueSurface>();
    ASSERT_TRUE(listener.wait(10s, [&] { return (heard += surfaces.take_latest(*surface) ? 1 : 0) > 20; }));
    EXPECT_GT(surface->nodes.size(), 100u);
    listener.listen(300ms);
    EXPECT_GT(listener.counter("hand", "surfaces_sent"), 20);
  }
  listener.listen(1s);  // until the writer knows that the reader has gone
  const double sent = listener.counter("hand", "surfaces_sent");
  listener.listen(1s);
  EXPECT_EQ(listener.counter("hand", "surfaces_sent"), sent) << "surfaces were sent after the reader had gone";
}

}  // namespace
}  // namespace softhand::rig
