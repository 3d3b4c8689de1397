// The supervisor with real children: shell scripts that live, die, or ignore SIGTERM.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <functional>
#include <string>
#include <vector>

#include "cli/supervisor.hpp"
#include "runtime/signals.hpp"

namespace softhand {
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
  // A restart never comes earlier than announced. (It may come later on a busy machine.)
  const auto starts = lines_with("alive");
  EXPECT_GE(starts[2].at - deaths[1].at, milliseconds(249));
  EXPECT_GE(starts[3].at - deaths[2].at, milliseconds(499));
  EXPECT_GE(supervisor_.restarts("flaky"), 3u);
  EXPECT_EQ(supervisor_.restarts("nobody"), 0u);
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

// A killed supervisor cannot stop its children. The kernel does it.
TEST(SupervisorDeath, ChildrenDieWithTheirSupervisor) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  const pid_t middle = fork();
  ASSERT_GE(middle, 0);
  if (middle == 0) {
    Supervisor supervisor([](const std::string&, const std::string&) {});
    supervisor.start({"child", {"/bin/sleep", "60"}});
    const pid_t child = supervisor.process_id("child");
    if (::write(ends[1], &child, sizeof child) != sizeof child) _exit(1);
    for (;;) supervisor.poll(milliseconds(100));
  }
  pid_t child = -1;
  ASSERT_EQ(read(ends[0], &child, sizeof child), static_cast<ssize_t>(sizeof child));
  EXPECT_TRUE(alive(child));
  kill(middle, SIGKILL);
  waitpid(middle, nullptr, 0);
  // If nobody reaps orphans, they may stay zombies. So a zombie counts as dead.
  const auto running = [child] {
    std::ifstream stat("/proc/" + std::to_string(child) + "/stat");
    std::string pid, name, state;
    return static_cast<bool>(stat >> pid >> name >> state) && state != "Z" && state != "X";
  };
  const auto until = Clock::now() + std::chrono::seconds(10);
  while (running() && Clock::now() < until) usleep(10000);
  EXPECT_FALSE(running());
  close(ends[0]);
  close(ends[1]);
}

}  // namespace
}  // namespace softhand
