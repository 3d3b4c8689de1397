// A tracker or its simulator as a process, and a reader of everything that a tracker publishes.
#pragma once

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include "bus/bus.hpp"
#include "device/health.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "support/own_domain.hpp"

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
      prctl(PR_SET_PDEATHSIG, SIGKILL);  // a real-time process that outlives a killed test disturbs all others
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
  pid_t id() const { return process_; }
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
      skeletons.take_all([&](const Skeleton& skeleton) {
        if (skeleton.hand.user == 0) hands[skeleton.hand.side] = skeleton, ++count;
      });
      heads.take_all([&](const HeadPose& pose) { head = pose; });
      statuses.take_all([&](const LoopStatus& newest) {
        if (module.empty() || get_text(newest.module) == module) status = newest;
      });
      if (done()) return true;
    }
    return false;
  }
  /// Waits until the tracker has this health. Returns false after ten seconds.
  bool until_health(Health of) {
    return until([] {}, [&] { return counter("health") == static_cast<double>(of); });
  }
  /// Waits until 50 hands of both sides have arrived from this source, and also a head if `with_head`.
  bool until_hands(std::uint32_t source, bool with_head) {
    hands = {};
    head = {};
    const int before = count;
    return until([] {},
                 [&] {
                   return count > before + 50 && hands[0].source == source && hands[1].source == source &&
                          (!with_head || head.valid == 1);
                 });
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
  int count = 0;       ///< of hands of user 0
  std::string module;  ///< whose status is read; empty: of any module
};

inline void check_latencies(std::vector<double>& latencies, const char* name) {
  ASSERT_GE(latencies.size(), 300u) << name;
  std::sort(latencies.begin(), latencies.end());
  const double p50 = latencies[latencies.size() / 2], p99 = latencies[latencies.size() * 99 / 100];
  std::printf("%s: latency added p50 %.2f ms, p99 %.2f ms (%zu packets)\n", name, p50, p99, latencies.size());
  EXPECT_GT(p50, 0) << name;
  EXPECT_LT(p50, 3) << name;  // the poll's period is 1 ms; the machine may be busy
}

/// Latency that a tracker adds: from the sending of a packet to the publication of its right hand, on one machine.
/// `send` sends one packet that becomes one sample of the right hand. Prints and checks the quantiles of 400 packets at
/// about 100 Hz.
template <typename Send>
void check_latency(TrackerListener& listener, const char* name, Send&& send) {
  // Packets that are lost while the endpoints find each other would be missing in the count of samples.
  std::uint64_t before = listener.hands[1].stamp.sequence;
  ASSERT_TRUE(listener.until(send, [&] { return listener.hands[1].stamp.sequence != before; })) << name;
  int quiet = 0;
  ASSERT_TRUE(listener.until([] {},
                             [&] {
                               quiet = listener.hands[1].stamp.sequence == before ? quiet + 1 : 0;
                               before = listener.hands[1].stamp.sequence;
                               return quiet == 10;
                             }))
      << name;
  std::vector<Nanoseconds> sent;
  std::vector<double> latencies;
  std::uint64_t newest = before;
  listener.until(
      [&] {
        sent.push_back(now());
        send();
      },
      [&] {
        const Stamp& stamp = listener.hands[1].stamp;
        if (stamp.sequence == newest) return false;
        newest = stamp.sequence;
        EXPECT_LE(newest - before, sent.size());
        if (newest - before > sent.size()) return true;
        latencies.push_back(static_cast<double>(stamp.publish_time - sent[newest - before - 1]) * 1e-6);
        return latencies.size() == 400;
      });
  check_latencies(latencies, name);
}

/// The same for a device whose sample time is the time at which it delivers: from then to the publication.
inline void check_stamped_latency(TrackerListener& listener, const char* name) {
  std::vector<double> latencies;
  std::uint64_t newest = listener.hands[1].stamp.sequence;
  listener.until([] {},
                 [&] {
                   const Stamp& stamp = listener.hands[1].stamp;
                   if (stamp.sequence != newest)
                     latencies.push_back(static_cast<double>(stamp.publish_time - stamp.sample_time) * 1e-6);
                   newest = stamp.sequence;
                   return latencies.size() == 400;
                 });
  check_latencies(latencies, name);
}

}  // namespace softhand::testing
