// The supervisor with real children: shell scripts that live, die, or ignore SIGTERM.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <functional>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "cli/supervisor.hpp"
#include "runtime/signals.hpp"

namespace softhand::cli_supervisor_test {
namespace {

using std::chrono::milliseconds;
using Clock = Supervisor::Clock;

struct Line {
  std::string name;
  std::string text;
  Clock::time_point at;
};

class SupervisorTest : public ::testing::Test {
 protected:
  std::vector<Line> lines_;  // must outlive the supervisor: its destructor still reports lines
  Supervisor supervisor_{[this](const std::string& name, const std::string& line) {
    lines_.push_back({name, line, Clock::now()});
  }};

  static ChildSpec shell(const std::string& name, const std::string& script) {
    return {name, {"/bin/sh", "-c", script}};
  }

  std::vector<Line> lines_with(const std::string& text) const {
    std::vector<Line> found;
    std::copy_if(lines_.begin(), lines_.end(), std::back_inserter(found),
                 [&text](const Line& l) { return l.text.find(text) != std::string::npos; });
    return found;
  }
  // The limit is generous because it only matters in a failing test.
  bool poll_until(const std::function<bool()>& done, milliseconds limit = milliseconds(20000)) {
    const auto until = Clock::now() + limit;
    while (!done() && Clock::now() < until) supervisor_.poll(milliseconds(20));
    return done();
  }
};

bool alive(pid_t pid) { return kill(pid, 0) == 0; }

// If nobody reaps orphans, they may stay zombies. So a zombie counts as dead.
bool runs(pid_t pid) {
  std::ifstream stat("/proc/" + std::to_string(pid) + "/stat");
  std::string id, name, state;
  return static_cast<bool>(stat >> id >> name >> state) && state != "Z" && state != "X";
}

bool ends(pid_t pid) {
  const auto until = Clock::now() + std::chrono::seconds(10);
  while (runs(pid) && Clock::now() < until) usleep(10000);
  return !runs(pid);
}

TEST_F(SupervisorTest, ForwardsEveryLineOfBothStreamsUnderTheChildsName) {
  supervisor_.start(shell("one", "echo first; echo second >&2; printf 'cut '; sleep 0.05; echo short; exec sleep 60"));
  supervisor_.start(shell("two", "echo other; exec sleep 60"));
  ASSERT_TRUE(poll_until([this] { return lines_.size() >= 4; }));
  EXPECT_EQ(lines_with("first").at(0).name, "one");
  EXPECT_EQ(lines_with("second").at(0).name, "one");
  EXPECT_EQ(lines_with("cut short").size(), 1u) << "a line that arrives in pieces is one line";
  EXPECT_EQ(lines_with("other").at(0).name, "two");
}

TEST_F(SupervisorTest, KeepsTheLastLineOfAChildThatDiesWithoutANewline) {
  supervisor_.start(shell("one", "printf 'last words'; kill -9 $$"));
  EXPECT_TRUE(poll_until([this] { return lines_with("last words").size() >= 1; }));
}

TEST_F(SupervisorTest, RestartsAtOnceThenDoublesTheDelayEachTime) {
  supervisor_.start(shell("flaky", "echo alive; exit 3"));
  ASSERT_TRUE(poll_until([this] { return lines_with("alive").size() >= 4; }));
  const auto deaths = lines_with("exit code 3");
  ASSERT_GE(deaths.size(), 3u);
  EXPECT_NE(deaths[0].text.find("in 0 ms"), std::string::npos) << deaths[0].text;
  EXPECT_NE(deaths[1].text.find("in 250 ms"), std::string::npos) << deaths[1].text;
  EXPECT_NE(deaths[2].text.find("in 500 ms"), std::string::npos) << deaths[2].text;
  EXPECT_GE(supervisor_.restarts("flaky"), 3u);
  EXPECT_EQ(supervisor_.restarts("nobody"), 0u);
}

// The log that takes the lines may be slow. A restart may come late on a busy machine, but never early.
TEST_F(SupervisorTest, RestartsNoEarlierThanItAnnounced) {
  std::vector<Line> lines;
  Supervisor supervisor([&lines](const std::string& name, const std::string& line) {
    if (line.find("exit code") != std::string::npos) usleep(50000);
    lines.push_back({name, line, Clock::now()});
  });
  supervisor.start(shell("flaky", "echo alive; exit 3"));
  const auto until = Clock::now() + std::chrono::seconds(20);
  const auto at = [&lines](const std::string& text, std::size_t index) {
    std::vector<Clock::time_point> times;
    for (const Line& line : lines) {
      if (line.text.find(text) != std::string::npos) times.push_back(line.at);
    }
    return times.at(index);
  };
  const auto starts = [&lines] {
    return std::count_if(lines.begin(), lines.end(), [](const Line& line) { return line.text == "alive"; });
  };
  while (starts() < 4 && Clock::now() < until) supervisor.poll(milliseconds(20));
  ASSERT_GE(starts(), 4);
  EXPECT_GE(at("alive", 2) - at("exit code", 1), milliseconds(250));
  EXPECT_GE(at("alive", 3) - at("exit code", 2), milliseconds(500));
}

TEST_F(SupervisorTest, ReportsTheSignalThatKilledAChildAndRestartsIt) {
  supervisor_.start(shell("victim", "echo up; exec sleep 60"));
  ASSERT_TRUE(poll_until([this] { return lines_with("up").size() == 1; }));
  const pid_t first = supervisor_.process_id("victim");
  kill(first, SIGKILL);
  ASSERT_TRUE(poll_until([this] { return lines_with("up").size() == 2; }));
  EXPECT_EQ(lines_with("killed by signal 9").size(), 1u);
  EXPECT_NE(supervisor_.process_id("victim"), first);
  EXPECT_EQ(supervisor_.restarts("victim"), 1u);
}

TEST_F(SupervisorTest, StopsAllChildrenWithSigterm) {
  const std::string loop = "; echo ready; while :; do sleep 0.01; done";
  supervisor_.start(shell("first", "trap 'echo term; exit 0' TERM" + loop));
  supervisor_.start(shell("second", "trap 'echo term; exit 0' TERM" + loop));
  ASSERT_TRUE(poll_until([this] { return lines_with("ready").size() == 2; }));
  EXPECT_TRUE(supervisor_.stop());
  EXPECT_EQ(lines_with("term").size(), 2u);
  EXPECT_EQ(supervisor_.process_id("first"), -1);
  EXPECT_EQ(supervisor_.process_id("second"), -1);
  EXPECT_EQ(supervisor_.restarts("first"), 0u) << "no child is restarted while stopping";
}

// Ctrl-C arrived while a process started. The start failed, and the rig ended with an error.
TEST_F(SupervisorTest, ASignalDoesNotEndAStart) {
  struct sigaction nothing {};
  nothing.sa_handler = [](int) {};
  struct sigaction before {};
  sigaction(SIGALRM, &nothing, &before);
  const itimerval often{{0, 200}, {0, 200}}, never{};
  setitimer(ITIMER_REAL, &often, nullptr);
  for (int i = 0; i < 10; ++i) EXPECT_NO_THROW(supervisor_.start(shell("child" + std::to_string(i), "exec sleep 60")));
  setitimer(ITIMER_REAL, &never, nullptr);
  sigaction(SIGALRM, &before, nullptr);
  EXPECT_TRUE(supervisor_.stop());
}

// `softhand up` stops through a signal handler. Between fork and exec a child still has this handler. A SIGTERM in that
// window only set a flag that nobody would read.
TEST_F(SupervisorTest, StopsAChildThatWasJustStarted) {
  const StopSignal handler;
  for (int i = 0; i < 50; ++i) {
    Supervisor supervisor([](const std::string&, const std::string&) {});
    supervisor.start({"newborn", {"/bin/sleep", "60"}});
    ASSERT_TRUE(supervisor.stop(milliseconds(2000))) << "start " << i;
  }
}

TEST_F(SupervisorTest, KillsAndReportsAChildThatDoesNotStopInTime) {
  supervisor_.start(shell("stubborn", "trap '' TERM; echo ready; while :; do sleep 0.01; done"));
  supervisor_.start(shell("polite", "echo ready; exec sleep 60"));
  ASSERT_TRUE(poll_until([this] { return lines_with("ready").size() == 2; }));
  const pid_t stubborn = supervisor_.process_id("stubborn");
  EXPECT_FALSE(supervisor_.stop(milliseconds(200)));
  EXPECT_EQ(lines_with("killing").size(), 1u);
  EXPECT_EQ(lines_with("killing").at(0).name, "stubborn");
  EXPECT_FALSE(alive(stubborn));
}

TEST_F(SupervisorTest, StopsInTurns) {
  const auto slow = [](const std::string& name, StopTurn turn) {
    ChildSpec child =
        shell(name, "trap 'echo asked; sleep 0.1; echo ends; exit 0' TERM; echo ready; while :; do sleep 0.01; done");
    child.stop = turn;
    return child;
  };
  supervisor_.start(slow("display", StopTurn::last));
  supervisor_.start(slow("world", StopTurn::in_turn));
  supervisor_.start(slow("glove", StopTurn::first));
  supervisor_.start(slow("tracker", StopTurn::in_turn));
  supervisor_.start(slow("vest", StopTurn::first));
  ASSERT_TRUE(poll_until([this] { return lines_with("ready").size() == 5; }));
  EXPECT_TRUE(supervisor_.stop());
  const auto names = [this](const std::string& text) {
    std::vector<std::string> found;
    for (const Line& line : lines_with(text)) found.push_back(line.name);
    return found;
  };
  const auto asked = names("asked"), ended = names("ends");
  ASSERT_EQ(asked.size(), 5u);
  EXPECT_EQ(std::set<std::string>(asked.begin(), asked.begin() + 2), (std::set<std::string>{"glove", "vest"}));
  EXPECT_EQ(std::vector<std::string>(asked.begin() + 2, asked.end()),
            (std::vector<std::string>{"tracker", "world", "display"}));
  const auto at = [this](const std::string& name, const std::string& text) {
    for (const Line& line : lines_with(text))
      if (line.name == name) return line.at;
    return Clock::time_point();
  };
  EXPECT_LE(at("glove", "ends"), at("tracker", "asked"));
  EXPECT_LE(at("tracker", "ends"), at("world", "asked"));
  EXPECT_LE(at("world", "ends"), at("display", "asked"));
}

TEST_F(SupervisorTest, AChildThatFallsSilentIsReplaced) {
  ChildSpec child = shell("sleepy", "echo up; exec sleep 600");
  child.longest_silence = milliseconds(300);
  supervisor_.start(child);
  supervisor_.start(shell("silent", "echo up; exec sleep 600"));
  ASSERT_TRUE(poll_until([this] { return lines_with("up").size() == 2; }));
  const pid_t first = supervisor_.process_id("sleepy");
  for (const auto until = Clock::now() + milliseconds(600); Clock::now() < until;) {
    supervisor_.heard("sleepy", first);
    supervisor_.poll(milliseconds(20));
  }
  EXPECT_EQ(supervisor_.process_id("sleepy"), first) << "it reported all the time";
  // Signs of life from others do not count: another process of this name, and another child.
  EXPECT_TRUE(poll_until([&] {
    supervisor_.heard("sleepy", getpid());
    supervisor_.heard("silent", first);
    return supervisor_.restarts("sleepy") == 1;
  }));
  EXPECT_EQ(lines_with("no status for").size(), 1u);
  EXPECT_EQ(supervisor_.restarts("silent"), 0u) << "it may be silent";
}

TEST_F(SupervisorTest, ASilentChildThatIgnoresSigtermIsKilled) {
  ChildSpec child = shell("stuck", "trap '' TERM; echo up; while :; do sleep 0.01; done");
  child.longest_silence = milliseconds(100);
  supervisor_.start(child);
  ASSERT_TRUE(poll_until([this] { return lines_with("up").size() == 1; }));
  supervisor_.heard("stuck", supervisor_.process_id("stuck"));
  EXPECT_TRUE(poll_until([this] { return supervisor_.restarts("stuck") == 1; }));
  EXPECT_EQ(lines_with("killed by signal 9").size(), 1u);
}

TEST_F(SupervisorTest, AStoppedDeviceIsReplacedAtOnce) {
  ChildSpec device = shell("glove", "echo up; exec sleep 600");
  device.stop = StopTurn::first;
  device.longest_silence = milliseconds(60000);
  supervisor_.start(device);
  supervisor_.start(shell("tracker", "echo up; exec sleep 600"));
  ASSERT_TRUE(poll_until([this] { return lines_with("up").size() == 2; }));
  const auto stopped_at = Clock::now();
  kill(supervisor_.process_id("tracker"), SIGSTOP);
  kill(supervisor_.process_id("glove"), SIGSTOP);
  EXPECT_TRUE(poll_until([this] { return lines_with("up").size() == 3; }));
  std::printf("up again %.0f ms after SIGSTOP\n",
              std::chrono::duration<double, std::milli>(Clock::now() - stopped_at).count());
  EXPECT_EQ(supervisor_.restarts("glove"), 1u);
  EXPECT_EQ(supervisor_.restarts("tracker"), 0u) << "only devices must not stand still";
  kill(supervisor_.process_id("tracker"), SIGCONT);
}

// Its guard stood still, too, and did not see that the device had stopped.
TEST_F(SupervisorTest, ADeviceWhoseGroupWasStoppedIsReplacedAtOnce) {
  ChildSpec device = shell("glove", "echo up; exec sleep 600");
  device.stop = StopTurn::first;
  supervisor_.start(device);
  ASSERT_TRUE(poll_until([this] { return lines_with("up").size() == 1; }));
  ASSERT_EQ(kill(-getpgid(supervisor_.process_id("glove")), SIGSTOP), 0);
  EXPECT_TRUE(poll_until([this] { return lines_with("up").size() == 2; }, milliseconds(5000)));
}

// The supervisor waited for ever. The alarm ends the test then.
TEST_F(SupervisorTest, AStoppedGroupIsStoppedInTime) {
  supervisor_.start(shell("stubborn", "trap '' TERM; echo up; while :; do sleep 0.01; done"));
  ASSERT_TRUE(poll_until([this] { return lines_with("up").size() == 1; }));
  const pid_t child = supervisor_.process_id("stubborn");
  const pid_t group = getpgid(child);
  // Stopped again and again, so that the guard cannot act.
  const pid_t stopper = fork();
  if (stopper == 0) {
    for (int i = 0; i < 20000 && kill(-group, SIGSTOP) == 0; ++i) usleep(1000);
    _exit(0);
  }
  alarm(20);
  EXPECT_FALSE(supervisor_.stop(milliseconds(200)));
  alarm(0);
  EXPECT_TRUE(ends(child));
  kill(stopper, SIGKILL);
  waitpid(stopper, nullptr, 0);
}

// As a program that ignores SIGCHLD starts it: the kernel then reaps the children.
TEST_F(SupervisorTest, AnInheritedDispositionOfSigchldDoesNotHideTheEndOfAChild) {
  const auto former = signal(SIGCHLD, SIG_IGN);
  std::vector<std::string> lines;
  {
    Supervisor supervisor([&lines](const std::string&, const std::string& line) { lines.push_back(line); });
    supervisor.start(shell("flaky", "exit 3"));
    const auto until = Clock::now() + milliseconds(5000);
    while (supervisor.restarts("flaky") == 0 && Clock::now() < until) supervisor.poll(milliseconds(20));
    EXPECT_EQ(supervisor.restarts("flaky"), 1u);
  }
  signal(SIGCHLD, former);
  ASSERT_FALSE(lines.empty());
  EXPECT_EQ(lines[0], "exit code 3; restarts in 0 ms");
}

// A machine without free files or processes ended the whole rig.
TEST_F(SupervisorTest, ARestartThatFailsIsTriedAgain) {
  supervisor_.start(shell("flaky", "echo up; sleep 0.3; exit 3"));
  ASSERT_TRUE(poll_until([this] { return lines_with("up").size() == 1; }));
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  const rlimit none{3, before.rlim_max};
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &none), 0);
  EXPECT_NO_THROW(poll_until([this] { return lines_with("cannot create a pipe").size() == 2; }));
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &before), 0);
  const auto failures = lines_with("cannot create a pipe");
  ASSERT_EQ(failures.size(), 2u);
  EXPECT_NE(failures[0].text.find("restarts in 250 ms"), std::string::npos) << failures[0].text;
  EXPECT_GE(failures[1].at - failures[0].at, milliseconds(250));
  EXPECT_EQ(supervisor_.restarts("flaky"), 0u);
  EXPECT_TRUE(poll_until([this] { return lines_with("up").size() == 2; }));
}

// The log takes a line in 1 ms, and the child prints faster. The supervisor did nothing else.
TEST_F(SupervisorTest, AChildThatPrintsWithoutEndDoesNotHoldUpTheOthers) {
  int lines = 0;
  Supervisor supervisor([&lines](const std::string&, const std::string& line) {
    if (line[0] != 'x') return;
    usleep(1000);
    if (++lines > 1000) throw std::runtime_error("no end of lines");
  });
  supervisor.start(shell("loud", "exec yes " + std::string(1000, 'x')));
  EXPECT_NO_THROW(while (lines == 0) supervisor.poll(milliseconds(20)));
  EXPECT_LE(lines, 70);
  EXPECT_NO_THROW(supervisor.stop());
}

TEST_F(SupervisorTest, ALineWithoutEndIsCut) {
  supervisor_.start(shell("endless", "head -c 100000 /dev/zero | tr '\\0' x; exec sleep 600"));
  const auto printed = [this] {
    std::size_t sum = 0;
    for (const Line& line : lines_) sum += line.text.size();
    return sum;
  };
  EXPECT_TRUE(poll_until([&] { return printed() >= 90000; }, milliseconds(5000)));
  for (const Line& line : lines_) EXPECT_LE(line.text.size(), 8192u);
}

// A device must send zero commands at its end, even if nobody reads what it prints.
TEST(SupervisorDeath, AChildThatPrintsAtItsEndReachesTheNextCommand) {
  const std::string done = "/tmp/softhand_supervisor_done_" + std::to_string(getpid());
  const pid_t middle = fork();
  ASSERT_GE(middle, 0);
  if (middle == 0) {
    bool up = false;
    Supervisor supervisor([&up](const std::string&, const std::string&) { up = true; });
    supervisor.start(
        {"glove",
         {"/bin/sh", "-c", "trap 'echo bye; touch " + done + "; exit 0' TERM; echo up; while :; do sleep 0.01; done"}});
    while (!up) supervisor.poll(milliseconds(20));
    kill(getpid(), SIGKILL);
  }
  waitpid(middle, nullptr, 0);
  const auto until = Clock::now() + std::chrono::seconds(5);
  while (access(done.c_str(), F_OK) != 0 && Clock::now() < until) usleep(10000);
  EXPECT_EQ(access(done.c_str(), F_OK), 0);
  unlink(done.c_str());
}

// After a pause of the whole machine, or of the supervisor, its children have not been silent.
TEST_F(SupervisorTest, APauseOfTheSupervisorIsNoSilence) {
  ChildSpec child = shell("healthy", "echo up; exec sleep 600");
  child.longest_silence = milliseconds(500);
  supervisor_.start(child);
  ASSERT_TRUE(poll_until([this] { return lines_with("up").size() == 1; }));
  supervisor_.heard("healthy", supervisor_.process_id("healthy"));
  usleep(1000000);
  supervisor_.poll(milliseconds(0));
  supervisor_.heard("healthy", supervisor_.process_id("healthy"));
  supervisor_.poll(milliseconds(20));
  EXPECT_TRUE(lines_with("no status").empty());
}

TEST_F(SupervisorTest, AConfigurationErrorIsFinal) {
  const std::string file = "/tmp/softhand_supervisor_" + std::to_string(getpid());
  std::ofstream(file) << "no program";
  chmod(file.c_str(), 0755);
  supervisor_.start(shell("wrong", "echo reason; exit 78"));
  supervisor_.start({"broken", {file}});
  supervisor_.start(shell("other", "exec sleep 600"));
  ASSERT_TRUE(poll_until([this] { return supervisor_.gave_up("wrong") && supervisor_.gave_up("broken"); }));
  unlink(file.c_str());
  EXPECT_EQ(lines_with("its configuration is wrong (exit code 78); not restarted").size(), 2u);
  EXPECT_EQ(lines_with("the program cannot be executed").size(), 1u);
  EXPECT_FALSE(supervisor_.gave_up("other"));
  EXPECT_TRUE(supervisor_.gave_up());
  poll_until([] { return false; }, milliseconds(500));
  EXPECT_EQ(lines_with("reason").size(), 1u);
  EXPECT_EQ(supervisor_.restarts("wrong"), 0u);
}

TEST_F(SupervisorTest, ReportsAChildThatFailsWhileStopping) {
  supervisor_.start(shell("sore", "trap 'exit 7' TERM; echo ready; while :; do sleep 0.01; done"));
  ASSERT_TRUE(poll_until([this] { return !lines_with("ready").empty(); }));
  EXPECT_TRUE(supervisor_.stop());
  EXPECT_EQ(lines_with("stopped, exit code 7").size(), 1u);
}

TEST_F(SupervisorTest, RefusesAProgramThatCannotRun) {
  try {
    supervisor_.start({"ghost", {"/nonexistent/softhand-ghost"}});
    FAIL() << "no error";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("ghost: cannot run /nonexistent/softhand-ghost: No such file"),
              std::string::npos)
        << error.what();
  }
}

TEST_F(SupervisorTest, ChildrenDoNotInheritOpenFiles) {
  // The pipe is not close-on-exec. The sockets of a DDS layer may not be either.
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  supervisor_.start(shell("lister", "ls /proc/self/fd | wc -l; exec sleep 60"));
  ASSERT_TRUE(poll_until([this] { return !lines_.empty(); }));
  EXPECT_EQ(std::stoi(lines_[0].text), 4) << "0, 1, 2 and the directory that ls reads";
  close(ends[0]);
  close(ends[1]);
}

// A process may start programs of its own. They must not hold its device or port when it is gone.
TEST_F(SupervisorTest, AChildsHelpersEndWithIt) {
  supervisor_.start(shell("parent", "sleep 600 & echo $!; exec sleep 600"));
  ASSERT_TRUE(poll_until([this] { return lines_.size() == 1; }));
  const pid_t helper = std::stoi(lines_[0].text);
  EXPECT_TRUE(runs(helper));
  kill(supervisor_.process_id("parent"), SIGKILL);
  ASSERT_TRUE(poll_until([this] { return supervisor_.restarts("parent") == 1; }));
  EXPECT_TRUE(ends(helper));
  ASSERT_TRUE(poll_until([this] { return lines_with("killed").size() == 1 && lines_.size() == 3; }));
  const pid_t next = std::stoi(lines_[2].text);
  EXPECT_TRUE(runs(next));
  EXPECT_TRUE(supervisor_.stop());
  EXPECT_TRUE(ends(next));
}

// Two helpers that leave the group and the session of their child. The second one has lost its parent, too.
constexpr const char* kRunaways = "setsid sleep 600 & echo $!; setsid sh -c 'sleep 600 & echo $!'; exec sleep 600";

TEST_F(SupervisorTest, HelpersInSessionsOfTheirOwnEndWithTheirChildAlone) {
  supervisor_.start(shell("parent", kRunaways));
  supervisor_.start(shell("other", kRunaways));
  ASSERT_TRUE(poll_until([this] { return lines_.size() == 4; }));
  std::vector<pid_t> own, others;
  for (const Line& line : lines_) (line.name == "parent" ? own : others).push_back(std::stoi(line.text));
  ASSERT_EQ(own.size(), 2u);
  ASSERT_EQ(others.size(), 2u);
  const auto has_own_session = [](pid_t helper) { return getsid(helper) != getsid(0); };
  ASSERT_TRUE(poll_until([&] {
    return std::all_of(own.begin(), own.end(), has_own_session) &&
           std::all_of(others.begin(), others.end(), has_own_session);
  }));
  kill(supervisor_.process_id("parent"), SIGKILL);
  ASSERT_TRUE(poll_until([this] { return supervisor_.restarts("parent") == 1; }));
  for (const pid_t helper : own) EXPECT_FALSE(runs(helper)) << "it ended before the restart";
  for (const pid_t helper : others) EXPECT_TRUE(runs(helper)) << "its child lives";
  ASSERT_TRUE(poll_until([this] { return lines_.size() == 7; }));
  EXPECT_TRUE(supervisor_.stop());
  for (const pid_t helper : others) EXPECT_FALSE(runs(helper));
  EXPECT_FALSE(runs(std::stoi(lines_[5].text))) << "a helper after the restart";
  EXPECT_FALSE(runs(std::stoi(lines_[6].text))) << "a helper after the restart";
}

// A killed supervisor cannot stop its children. The guards do it.
TEST(SupervisorDeath, ChildrenDieWithTheirSupervisor) {
  int ends_of_pipe[2];
  ASSERT_EQ(pipe(ends_of_pipe), 0);
  const pid_t middle = fork();
  ASSERT_GE(middle, 0);
  if (middle == 0) {
    Supervisor supervisor([](const std::string&, const std::string&) {});
    supervisor.start({"child", {"/bin/sleep", "60"}});
    const pid_t child = supervisor.process_id("child");
    if (::write(ends_of_pipe[1], &child, sizeof child) != sizeof child) _exit(1);
    for (;;) supervisor.poll(milliseconds(100));
  }
  pid_t child = -1;
  ASSERT_EQ(read(ends_of_pipe[0], &child, sizeof child), static_cast<ssize_t>(sizeof child));
  EXPECT_TRUE(alive(child));
  kill(middle, SIGKILL);
  waitpid(middle, nullptr, 0);
  EXPECT_TRUE(ends(child));
  close(ends_of_pipe[0]);
  close(ends_of_pipe[1]);
}

class HelpersOfAKilledSupervisor : public ::testing::TestWithParam<const char*> {};

TEST_P(HelpersOfAKilledSupervisor, End) {
  int ends_of_pipe[2];
  ASSERT_EQ(pipe(ends_of_pipe), 0);
  const pid_t middle = fork();
  ASSERT_GE(middle, 0);
  if (middle == 0) {
    pid_t helper = -1;
    Supervisor supervisor([&helper](const std::string&, const std::string& line) { helper = std::stoi(line); });
    supervisor.start({"child", {"/bin/sh", "-c", GetParam()}});
    while (helper < 0) supervisor.poll(milliseconds(100));
    if (::write(ends_of_pipe[1], &helper, sizeof helper) != sizeof helper) _exit(1);
    for (;;) supervisor.poll(milliseconds(100));
  }
  pid_t helper = -1;
  ASSERT_EQ(read(ends_of_pipe[0], &helper, sizeof helper), static_cast<ssize_t>(sizeof helper));
  EXPECT_TRUE(runs(helper));
  kill(middle, SIGKILL);
  waitpid(middle, nullptr, 0);
  EXPECT_TRUE(ends(helper));
  close(ends_of_pipe[0]);
  close(ends_of_pipe[1]);
}

INSTANTIATE_TEST_SUITE_P(Supervisor, HelpersOfAKilledSupervisor,
                         ::testing::Values("sleep 600 & echo $!; exec sleep 600",
                                           "setsid sleep 600 & echo $!; exec sleep 600",
                                           "trap '' TERM; setsid sleep 600 & echo $!; sleep 600; sleep 600"));

}  // namespace
}  // namespace softhand::cli_supervisor_test
