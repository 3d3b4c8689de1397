// The processes of a rig and their operating system: one rig per domain, deaths, priorities, and cores.
#include <gtest/gtest.h>
#include <sched.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <set>

#include "integration/rig_fixture.hpp"
#include "runtime/exit_codes.hpp"

namespace softhand::rig::rig_processes_test {
namespace {

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
    EXPECT_EQ(second.wait(8s), 0) << second.output();
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

// DDS reports its own errors, here of its settings. They must not be in the data that `softhand` prints.
TEST_F(Rig, AnErrorOfDdsIsNotInTheJsonOfTheStatus) {
  const std::string settings = std::filesystem::temp_directory_path() / ("softhand_broken_" + std::to_string(getpid()));
  std::ofstream(settings) << "<broken";
  const auto status = [&](const std::string& rest) {
    return run_program(
        {"/bin/sh", "-c",
         "FASTRTPS_DEFAULT_PROFILES_FILE=" + settings + " " SOFTHAND_PROGRAMS "/softhand status --json" + rest});
  };
  EXPECT_NE(status(" 2>&1 > /dev/null").output.find("XMLPARSER"), std::string::npos);
  EXPECT_EQ(status(" 2> /dev/null").output, "{}\n");
  std::filesystem::remove(settings);
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

}  // namespace
}  // namespace softhand::rig::rig_processes_test
