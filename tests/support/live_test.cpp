// live_test COMMAND...: runs a test of real processes, which needs a machine that runs them in time.
//
// Beside the test it wakes every 5 ms with the highest real-time priority. Only a stop of the whole machine delays it
// by more than 60 ms: the host of a virtual machine gave its cores to others. Such a stop looks like a dead process to
// each deadline, lease and watchdog. The result of a test then says nothing about the programs.
//
// The exit code is the test's own, with two exceptions. Both give 77, with the measured stops, and ctest reports the
// test as skipped:
// - The test failed, and stops took over 5 % of its time. It gets two more chances.
// - Stops took over 20 % of the time after three seconds or later. The test is ended.
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <fstream>
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

/// The stops of the machine during one run of the test.
class Stops {
 public:
  void wait() {
    due_ += kPeriod;
    std::this_thread::sleep_until(due_);
    const Clock::time_point now = Clock::now();
    if (now - due_ < kStop) return;
    lost_ += now - due_;
    longest_ = std::max<Seconds>(longest_, now - due_);
    due_ = now;
  }
  Seconds elapsed() const { return Clock::now() - start_; }
  double lost_share() const { return lost_ / elapsed(); }
  void print() const {
    std::printf("live_test: the machine stood still for %.2f of %.2f s, at most for %.2f s at a time\n", lost_.count(),
                elapsed().count(), longest_.count());
  }

 private:
  const Clock::time_point start_ = Clock::now();
  Clock::time_point due_ = start_;
  Seconds lost_{}, longest_{};
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
  const sched_param highest{sched_get_priority_max(SCHED_FIFO)};
  sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &highest);  // it may be forbidden: then load delays us too
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
      stops.wait();
      is_hopeless = stops.elapsed() > 3s && stops.lost_share() > kHopeless;
    }
    const int code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    const bool is_excused = is_hopeless || (code != 0 && code != kSkipped && stops.lost_share() > kExcuse);
    if (is_excused) stops.print();
    if (is_hopeless) kill(-test, SIGKILL);
    end_children();
    if (!is_excused) return code;
    if (is_hopeless) break;
    used += stops.elapsed();
  }
  std::puts("live_test: skipped, because this test needs a machine that runs its processes in time");
  return kSkipped;
}
