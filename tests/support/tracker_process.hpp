// A tracker or its simulator as a process, and a reader of everything that a tracker publishes.
#pragma once

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "bus/bus.hpp"
#include "messages/convert.hpp"

namespace softhand::testing {

/// A running program of build/<preset>/bin. The destructor ends it.
class Process {
 public:
  /// With `reads_line` the constructor waits for the first line of its output.
  Process(const std::string& program, const std::vector<std::string>& arguments, bool reads_line) {
    int ends[2];
    EXPECT_EQ(pipe(ends), 0);
    const std::string path = std::string(SOFTHAND_PROGRAMS) + "/" + program;
    std::vector<const char*> argv{path.c_str()};
    for (const std::string& argument : arguments) argv.push_back(argument.c_str());
    argv.push_back(nullptr);
    process_ = fork();
    if (process_ == 0) {
      if (reads_line) dup2(ends[1], 1);
      execv(path.c_str(), const_cast<char**>(argv.data()));
      _exit(127);
    }
    close(ends[1]);
    for (char c = 0; reads_line && read(ends[0], &c, 1) == 1 && c != '\n';) line_ += c;
    close(ends[0]);
  }
  ~Process() {
    if (process_ != 0) end(SIGTERM);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  /// Returns the wait status.
  int end(int signal) {
    kill(process_, signal);
    int status = 0;
    waitpid(process_, &status, 0);
    process_ = 0;
    return status;
  }
  const std::string& line() const { return line_; }
  /// The number after `text` in the first line, -1 without it.
  int number_after(const std::string& text) const {
    const std::size_t at = line_.find(text);
    EXPECT_NE(at, std::string::npos) << line_;
    return at == std::string::npos ? -1 : std::atoi(line_.c_str() + at + text.size());
  }

 private:
  pid_t process_ = 0;
  std::string line_;
};

/// The domain of this test program and of the processes that it starts.
inline void use_domain_of_this_process() { setenv("SOFTHAND_DOMAIN", std::to_string(100 + getpid() % 100).c_str(), 1); }

struct TrackerListener {
  TrackerListener()
      : participant("tracker-test"),
        skeletons(participant, bus::topics::tracked_skeleton),
        heads(participant, bus::topics::head_pose),
        statuses(participant, bus::topics::loop_status) {}
  /// Calls `send` at 100 Hz until `done`. Returns false after ten seconds.
  template <typename Send, typename Done>
  bool until(Send&& send, Done&& done) {
    for (int i = 0; i < 1000; ++i) {
      send();
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      skeletons.take_all([&](const Skeleton& skeleton) { hands[skeleton.hand.side] = skeleton, ++count; });
      heads.take_all([&](const HeadPose& pose) { head = pose; });
      statuses.take_all([&](const LoopStatus& newest) { status = newest; });
      if (done()) return true;
    }
    return false;
  }
  /// -1 before the first status with this counter.
  double counter(const std::string& name) const {
    for (const NamedValue& each : status.counters)
      if (get_text(each.name) == name) return each.value;
    return -1;
  }
  bus::Participant participant;
  bus::Reader<Skeleton> skeletons;
  bus::Reader<HeadPose> heads;
  bus::Reader<LoopStatus> statuses;
  std::array<Skeleton, 2> hands{};  ///< left, right: the newest ones
  HeadPose head;
  LoopStatus status;
  int count = 0;  ///< of hands
};

}  // namespace softhand::testing
