// A loop at a fixed rate, on the absolute grid of its start.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <string>
#include <vector>

#include "messages/messages.hpp"
#include "runtime/clock.hpp"
#include "runtime/simulated_clock.hpp"
#include "runtime/statistics.hpp"

namespace softhand {

/// When steps are due, apart from any clock. Steps lie on the grid start + n * period and never drift from it. A step
/// that ends after the next one was due is followed at once by one late step; the further ones that it made late are
/// skipped for good, so that a stall is never made up for by a burst.
class Schedule {
 public:
  Schedule(Nanoseconds start, Nanoseconds period) : due_(start), period_(period) {}

  Nanoseconds due() const { return due_; }
  /// After a step, at time `now`: sets `due` to the next step's time, in the past when it is late.
  void advance(Nanoseconds now) {
    due_ += period_;
    if (now <= due_) return;
    const Nanoseconds skipped = (now - due_) / period_;
    misses_ += static_cast<std::uint64_t>(skipped) + 1;
    due_ += skipped * period_;
  }
  /// Steps that did not start when they were due: late or skipped.
  std::uint64_t misses() const { return misses_; }

 private:
  Nanoseconds due_;
  Nanoseconds period_;
  std::uint64_t misses_ = 0;
};

/// Runs a step at a rate in the calling thread and measures it. Nothing allocates, locks or logs after construction, as
/// far as the step does not.
class PeriodicLoop {
 public:
  /// Throws std::invalid_argument unless rate_hz is in [0.1, 100000].
  explicit PeriodicLoop(double rate_hz);

  /// Calls `step(start)` on time, with the time of its actual start, until `stop` is set; looks at `stop` once a
  /// period.
  template <typename Step>
  void run(const std::atomic<bool>& stop, Step&& step) {
    run(stop, SimulatedClock(), step, [](Nanoseconds) {});
  }

  /// Lays the grid on `clock`, which may be commanded meanwhile, and gives `step` its time: a slowed clock has as many
  /// steps a simulated second as ever. `between(now)`, of real time, is called after each step, and 50 times a second
  /// at least while the clock keeps the next one waiting.
  template <typename Step, typename Between>
  void run(const std::atomic<bool>& stop, const SimulatedClock& clock, Step&& step, Between&& between) {
    schedule_ = Schedule(clock.at(now()), period_);
    while (!stop.load(std::memory_order_relaxed)) {
      const Nanoseconds started = now();
      const bool due = started >= clock.when(schedule_.due());
      if (due) step(clock.at(started));
      between(now());
      const Nanoseconds ended = now();
      if (due) {
        step_times_.add(ended, ended - started);
        ++steps_;
        schedule_.advance(clock.at(ended));
      } else {
        step_times_.expire(ended);  // a loop that stands has no rate
      }
      sleep_until(std::min(clock.when(schedule_.due()), ended + kLongestSleep));
    }
  }

  /// Process id, rates, step times, steps and misses; call it within the step, or after the run. The other fields stay
  /// as they are.
  void fill(LoopStatus& status) const;

  std::uint64_t steps() const { return steps_; }
  std::uint64_t deadline_misses() const { return schedule_.misses(); }
  const RollingHistogram& step_times() const { return step_times_; }

 private:
  static constexpr Nanoseconds kLongestSleep = 20'000'000;
  static void sleep_until(Nanoseconds time);

  double rate_hz_;
  Nanoseconds period_;
  Schedule schedule_;
  RollingHistogram step_times_;
  std::uint64_t steps_ = 0;
};

/// Locks the process's memory and gives the calling thread SCHED_FIFO `priority` (1..99). Returns a warning for each
/// that the system refused, with the reason: the loop then runs all the same, with less certain times. Threads started
/// later inherit the priority, and have stacks of a megabyte.
std::vector<std::string> request_real_time(int priority);

}  // namespace softhand
