// A loop at a fixed rate. Its steps lie on an absolute time grid.
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

/// Computes when steps are due, without reading a clock. Steps lie on the grid start + n * period and never drift from
/// it. If a step ends after the next step was due, one late step follows immediately. Further missed steps are skipped,
/// so a stall never causes a burst of steps.
class Schedule {
 public:
  Schedule(Nanoseconds start, Nanoseconds period) : due_(start), period_(period) {}

  Nanoseconds due() const { return due_; }
  /// Call it after a step, at time `now`. Sets `due` to the time of the next step, which is in the past if that step is
  /// late.
  void advance(Nanoseconds now) {
    due_ += period_;
    if (now <= due_) return;
    const Nanoseconds skipped = (now - due_) / period_;
    misses_ += static_cast<std::uint64_t>(skipped) + 1;
    due_ += skipped * period_;
  }
  /// Moves the grid: the steps after the one that is due now. Call it before `advance`.
  void shift(Nanoseconds by) { due_ += by; }
  /// Number of steps that did not start on time: late or skipped.
  std::uint64_t misses() const { return misses_; }

 private:
  Nanoseconds due_;
  Nanoseconds period_;
  std::uint64_t misses_ = 0;
};

/// Runs a step function at a fixed rate in the calling thread and measures it. After construction the loop does not
/// allocate, lock or log (the step function may).
class PeriodicLoop {
 public:
  /// Throws std::invalid_argument unless rate_hz is in [0.1, 100000].
  explicit PeriodicLoop(double rate_hz);

  /// Calls `step(start)` on time until `stop` is set. `start` is the actual start time. Checks `stop` once per period.
  template <typename Step>
  void run(const std::atomic<bool>& stop, Step&& step) {
    run(stop, SimulatedClock(), step, [](Nanoseconds) {});
  }

  /// Like the function above, but the grid and the argument of `step` are on `clock`. Commands may change `clock`
  /// during the run. The number of steps per simulated second does not depend on the pace. `between(now)` gets real
  /// time. It is called after each step, and at least 50 times per second while the next step waits.
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
        step_times_.expire(ended);  // a stopped loop has rate 0
      }
      sleep_until(std::min(clock.when(schedule_.due()), ended + kLongestSleep));
    }
  }

  /// Sets process id, rates, step times, steps and misses. Call it inside the step or after the run. Other fields are
  /// not changed.
  void fill(LoopStatus& status) const;

  /// When the present step was due, on the clock of the loop. Call it inside the step.
  Nanoseconds due() const { return schedule_.due(); }
  /// Moves the grid of the later steps. Call it inside the step.
  void shift(Nanoseconds by) { schedule_.shift(by); }

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

}  // namespace softhand
