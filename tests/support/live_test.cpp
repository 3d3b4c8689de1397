// live_test COMMAND...: runs a test of real processes, which needs a machine that runs them in time.
//
// Beside the test it wakes on each core every 5 ms with the highest real-time priority. Only a stop of the core delays
// it by more than 60 ms: the host of a virtual machine gave the core to others. Such a stop looks like a dead process
// to each deadline, lease and watchdog. The result of a test then says nothing about the programs.
//
// The exit code is the test's own, with two exceptions. Both give 77, and ctest reports the test as skipped:
// - The test failed, and the stops of a core took over 5 % of its time. It gets two more chances.
// - The stops of a core took over 20 % of the time after three seconds or later. The test is ended.
// The stops beside a test that failed are printed.
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <list>
#include <string>
#include <thread>

namespace {

using Clock = std::chrono::steady_clock;
using Seconds = std::chrono::duration<double>;
using namespace std::chrono_literals;

constexpr int kSkipped = 77;
constexpr Clock::duration kPeriod = 5ms;
constexpr Clock::duration kStop = 60ms;  // Linux delays real-time threads by at most 50 ms in each second
constexpr double kExcuse = 0.05, kHopeless = 0.2;

/// The stops of one core since construction.
class CoreStops {
 public:
  explicit CoreStops(std::size_t core)
      : watcher_([this, core](const std::stop_token& stop) {
          cpu_set_t only;
          CPU_ZERO(&only);
          CPU_SET(core, &only);
          sched_setaffinity(0, sizeof only, &only);
          const sched_param highest{sched_get_priority_max(SCHED_FIFO)};
          sched_setscheduler(0, SCHED_FIFO, &highest);  // it may be forbidden: then load delays us too
          watch(stop);
        }) {}
  Seconds lost() const { return lost_.load(); }
  Seconds longest() const { return longest_.load(); }

 private:
  void watch(const std::stop_token& stop) {
    for (Clock::time_point due = Clock::now(); !stop.stop_requested();) {
      due += kPeriod;
      std::this_thread::sleep_until(due);
      const Clock::time_point now = Clock::now();
      if (now - due < kStop) continue;
      lost_ = lost_.load() + (now - due);
      longest_ = std::max<Seconds>(longest_.load(), now - due);
      due = now;
    }
  }

  std::atomic<Seconds> lost_{}, longest_{};
  std::jthread watcher_;
};

/// The stops of all cores that this process may use, during one run of the test.
class Stops {
 public:
  Stops() {
    cpu_set_t cores;
    sched_getaffinity(0, sizeof cores, &cores);
    for (std::size_t core = 0; core < CPU_SETSIZE; ++core) {
      if (CPU_ISSET(core, &cores)) cores_.emplace_back(core);
    }
  }
  Seconds elapsed() const { return Clock::now() - start_; }
  /// Of the core that lost most.
  double lost_share() const { return worst().lost() / elapsed(); }
  void print() const {
    std::printf("live_test: a core stood still for %.2f of %.2f s, at most for %.2f s at a time\n",
                worst().lost().count(), elapsed().count(), worst().longest().count());
  }

 private:
  const CoreStops& worst() const {
    return *std::max_element(cores_.begin(), cores_.end(),
                             [](const CoreStops& a, const CoreStops& b) { return a.lost() < b.lost(); });
  }

  const Clock::time_point start_ = Clock::now();
  std::list<CoreStops> cores_;
};

/// Starts the test in a process group of its own. It ends with this process. Returns its id, or -1 if fork fails.
pid_t start(char** command) {
  const pid_t test = fork();
  if (test != 0) return test;
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  setpgid(0, 0);
  execvp(command[0], command);
  std::perror(command[0]);
  _exit(127);
}

/// Ends all processes that the test left behind. They have five seconds for it.
void end_children() {
  const Clock::time_point limit = Clock::now() + 5s;
  const std::string list = "/proc/self/task/" + std::to_string(getpid()) + "/children";
  for (;; std::this_thread::sleep_for(kPeriod)) {
    pid_t ended = 0;
    while ((ended = waitpid(-1, nullptr, WNOHANG)) > 0) continue;
    if (ended < 0) return;  // there is no child
    std::ifstream children(list);
    for (pid_t child; Clock::now() > limit && children >> child;) kill(child, SIGKILL);
  }
}

}  // namespace

int main(int, char** arguments) {
  if (arguments[1] == nullptr) {
    std::fputs("usage: live_test COMMAND...\n", stderr);
    return 2;
  }
  prctl(PR_SET_CHILD_SUBREAPER, 1);
  Seconds used{};
  for (int run = 0; run < 3 && used < 30s; ++run) {
    Stops stops;
    const pid_t test = start(arguments + 1);
    if (test < 0) {
      std::perror("live_test: fork");
      return 1;
    }
    int status = 0;
    bool is_hopeless = false;
    while (!is_hopeless && waitpid(test, &status, WNOHANG) != test) {
      std::this_thread::sleep_for(kPeriod);
      is_hopeless = stops.elapsed() > 3s && stops.lost_share() > kHopeless;
    }
    const int code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    const bool is_excused = is_hopeless || (code != 0 && code != kSkipped && stops.lost_share() > kExcuse);
    if (is_hopeless || (code != 0 && code != kSkipped)) stops.print();
    if (is_hopeless) kill(-test, SIGKILL);
    end_children();
    if (!is_excused) return code;
    if (is_hopeless) break;
    used += stops.elapsed();
  }
  std::puts("live_test: skipped, because this test needs a machine that runs its processes in time");
  return kSkipped;
}
