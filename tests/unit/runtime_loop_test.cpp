// Statistics, schedule, loop and simulated clock.
#include <gtest/gtest.h>
#include <linux/capability.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "runtime/periodic_loop.hpp"
#include "runtime/phase_lock.hpp"
#include "runtime/scheduling.hpp"
#include "runtime/simulated_clock.hpp"
#include "runtime/statistics.hpp"

namespace softhand::runtime_loop_test {
namespace {

TEST(RollingHistogram, QuantilesAgreeWithSorting) {
  std::mt19937_64 random(7);
  std::lognormal_distribution<double> distribution(std::log(2e5), 2);
  auto histogram = std::make_unique<RollingHistogram>();
  std::vector<Nanoseconds> all;
  for (int i = 0; i < 5000; ++i) {
    all.push_back(static_cast<Nanoseconds>(distribution(random)));
    histogram->add(5'000'000'000 + i * 100'000, all.back());
  }
  std::sort(all.begin(), all.end());
  for (const double p : {0.001, 0.5, 0.99, 0.999, 1.0}) {
    const auto exact = static_cast<double>(all[static_cast<std::size_t>(std::ceil(p * 5000)) - 1]);
    EXPECT_NEAR(static_cast<double>(histogram->quantile(p)), exact, 0.016 * exact + 1) << p;
  }
}

TEST(RollingHistogram, ForgetsValuesOlderThanASecond) {
  auto histogram = std::make_unique<RollingHistogram>();
  EXPECT_EQ(histogram->quantile(0.5), 0);
  for (int i = 0; i < 100; ++i) histogram->add(i * 1'000'000, 5'000'000);
  for (int i = 0; i < 1000; ++i) histogram->add(1'100'000'000 + i * 900'000, 1000);
  EXPECT_EQ(histogram->count(), 1000u);
  EXPECT_NEAR(static_cast<double>(histogram->quantile(1)), 1000, 16);
  histogram->expire(60'000'000'000);
  EXPECT_EQ(histogram->count(), 0u);
  EXPECT_EQ(histogram->rate(), 0);
}

TEST(RollingHistogram, AcceptsExtremeValues) {
  auto histogram = std::make_unique<RollingHistogram>();
  for (Nanoseconds x = 0; x < 70; ++x) {  // buckets of one value, then of two
    RollingHistogram one;
    one.add(0, x);
    EXPECT_NEAR(static_cast<double>(one.quantile(1)), static_cast<double>(x), x < 64 ? 0 : 1) << x;
  }
  histogram->add(0, -5);
  EXPECT_EQ(histogram->quantile(1), 0);
  histogram->add(0, INT64_MAX);
  EXPECT_GT(histogram->quantile(1), 1'000'000'000'000);
}

TEST(RollingHistogram, RateIsExactOnAnEvenGrid) {
  for (const double rate : {60.0, 90.0, 1000.0}) {
    auto histogram = std::make_unique<RollingHistogram>();
    for (int i = 0; i < 5000; ++i) histogram->add(1'000'000'000 + std::llround(i * 1e9 / rate), 1);
    EXPECT_NEAR(histogram->rate(), rate, 1e-3 * rate);
  }
}

TEST(Schedule, StaysOnItsGridWhenInTime) {
  Schedule schedule(1000, 10);
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(schedule.due(), 1000 + 10 * i);
    schedule.advance(schedule.due() + 7);
  }
  schedule.advance(schedule.due() + 10);  // the step ended just when the next one is due
  EXPECT_EQ(schedule.misses(), 0u);
}

TEST(Schedule, AStallCausesOneLateStepOnly) {
  Schedule schedule(0, 10);
  schedule.advance(2004);  // a stall of 200 periods: 10 to 2000 were missed
  EXPECT_EQ(schedule.misses(), 200u);
  EXPECT_EQ(schedule.due(), 2000);  // one late step at once
  schedule.advance(2006);
  EXPECT_EQ(schedule.due(), 2010);  // then back on the grid
  EXPECT_EQ(schedule.misses(), 200u);
}

TEST(Schedule, OverloadFallsBehindByLessThanAPeriod) {
  Schedule schedule(0, 10);
  Nanoseconds clock = 0;
  for (int i = 0; i < 1000; ++i) {
    clock = std::max(clock, schedule.due()) + 25;  // every step takes 2.5 periods
    schedule.advance(clock);
    EXPECT_LE(clock - schedule.due(), 10);
  }
  // Every grid point after the first was late or skipped, and each is counted once.
  EXPECT_EQ(schedule.misses(), static_cast<std::uint64_t>(schedule.due() / 10));
}

TEST(PeriodicLoop, RefusesImpossibleRates) {
  for (const double rate : {0.0, -1.0, 1e9, std::nan(""), HUGE_VAL})
    EXPECT_THROW(PeriodicLoop{rate}, std::invalid_argument) << rate;
}

TEST(PeriodicLoop, NeverRunsEarlyAndStops) {
  auto loop = std::make_unique<PeriodicLoop>(500);
  std::atomic<bool> stop{false};
  std::vector<Nanoseconds> starts;
  const Nanoseconds begin = now();
  loop->run(stop, [&](Nanoseconds start) {
    starts.push_back(start);
    if (starts.size() == 100) stop = true;
  });
  ASSERT_EQ(starts.size(), 100u);
  EXPECT_EQ(loop->steps(), 100u);
  for (std::size_t i = 0; i < starts.size(); ++i)
    EXPECT_GE(starts[i] - begin, static_cast<Nanoseconds>(i) * 2'000'000) << i;
  LoopStatus status;
  loop->fill(status);
  EXPECT_EQ(status.nominal_rate_hz, 500);
  EXPECT_EQ(status.steps, 100u);
  EXPECT_GT(status.rate_hz, 0);
}

TEST(PeriodicLoop, CountsAStallAndSkipsIt) {
  auto loop = std::make_unique<PeriodicLoop>(1000);
  std::atomic<bool> stop{false};
  int steps = 0;
  const Nanoseconds begin = now();
  loop->run(stop, [&](Nanoseconds) {
    if (++steps == 5) std::this_thread::sleep_for(std::chrono::milliseconds(50));
    if (steps == 10) stop = true;
  });
  EXPECT_GE(now() - begin, 54'000'000);  // 4 periods, the stall, and the next grid points
  EXPECT_GE(loop->deadline_misses(), 49u);
  EXPECT_GE(loop->step_times().quantile(1), 49'000'000);
}

constexpr Nanoseconds kSecond = 1'000'000'000;

// A loop of 90 Hz and a tracker whose samples arrive at a rate with jitter. Returns the waits of the last steps: due
// time minus arrival of the newest sample.
struct PhaseRun {
  std::vector<double> waits_ms;
  double largest_shift = 0;  // of the period, after the first one
  Nanoseconds moved = 0;
  bool locked = false;
};
PhaseRun run_phase_lock(double source_hz, double jitter_ms, Nanoseconds first_arrival, Nanoseconds margin = 1'500'000,
                        int steps = 400) {
  constexpr Nanoseconds kPeriod = 11'111'111;
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> jitter(0, jitter_ms * 1e6);
  PhaseLock lock(kPeriod, margin);
  PhaseRun out;
  Nanoseconds due = 1'000'000'000'000, arrival = 0;
  const Nanoseconds begin = due;
  std::int64_t sample = 0;
  const auto arrives = [&](std::int64_t i) {
    return begin + first_arrival + static_cast<Nanoseconds>(1e9 * static_cast<double>(i) / source_hz);
  };
  double late = jitter(random);
  for (int i = 0; i < steps; ++i) {
    for (; arrives(sample) + static_cast<Nanoseconds>(late) <= due; ++sample, late = jitter(random))
      arrival = arrives(sample) + static_cast<Nanoseconds>(late);
    const Nanoseconds shift = lock.follow(due, arrival);
    if (i >= steps - 200) out.waits_ms.push_back(static_cast<double>(due - arrival) * 1e-6);
    if (out.moved != 0) out.largest_shift = std::max(out.largest_shift, std::abs(static_cast<double>(shift)) / kPeriod);
    out.moved += shift;
    due += kPeriod + shift;
  }
  out.locked = lock.locked();
  return out;
}

TEST(PhaseLock, StepsStartTheMarginAfterTheSamplesFromAnyPhase) {
  for (Nanoseconds phase = 0; phase < 11'000'000; phase += 1'000'000) {
    for (const double hz : {90.0, 30.0, 180.0, 90.1}) {
      const PhaseRun run = run_phase_lock(hz, 0, phase);
      EXPECT_TRUE(run.locked) << hz;
      // A source of 30 Hz brings a sample to each third step.
      const double least = *std::min_element(run.waits_ms.begin(), run.waits_ms.end());
      // At 90.1 Hz the phase drifts by 12 us in each step, and the estimate looks back over 32 samples.
      EXPECT_NEAR(least, 1.5, hz == 90.1 ? 0.6 : 0.15) << hz << " Hz, " << phase;
      EXPECT_LE(run.largest_shift, 0.005);
    }
  }
}

TEST(PhaseLock, JitterCostsItsOwnLength) {
  auto run = run_phase_lock(90, 3, 4'000'000);
  EXPECT_TRUE(run.locked);
  std::sort(run.waits_ms.begin(), run.waits_ms.end());
  EXPECT_LT(run.waits_ms[run.waits_ms.size() / 2], 1.5 + 3);
  // At most one of ten samples misses its step: the step has a sample that is a period old.
  EXPECT_LT(run.waits_ms[run.waits_ms.size() * 85 / 100], 1.5 + 3);
  EXPECT_GE(run.waits_ms.front(), 0);
}

TEST(PhaseLock, ASourceWithoutACommonPhaseMovesNothing) {
  for (const double hz : {60.0, 72.0, 120.0}) {
    const PhaseRun run = run_phase_lock(hz, 0.5, 4'000'000);
    EXPECT_FALSE(run.locked) << hz;
    EXPECT_EQ(run.moved, 0) << hz;
  }
  EXPECT_EQ(run_phase_lock(90, 11, 4'000'000, 1'500'000, 100).locked, false);  // jitter as long as the period
}

TEST(PhaseLock, ForgetsASilentSourceAndIgnoresTimesThatCannotBe) {
  constexpr Nanoseconds kPeriod = 11'111'111;
  PhaseLock lock(kPeriod, 1'500'000);
  constexpr Nanoseconds kBegin = 1'000'000'000'000;
  Nanoseconds due = kBegin + 5'000'000;
  const auto run = [&](int steps, auto arrival) {
    for (int i = 0; i < steps; ++i) due += kPeriod + lock.follow(due, arrival());
  };
  const auto newest = [&due] { return due - (due - kBegin) % kPeriod; };
  run(100, newest);
  EXPECT_TRUE(lock.locked());
  run(20, [] { return Nanoseconds{0}; });  // no sample
  EXPECT_TRUE(lock.locked());
  run(100, [] { return Nanoseconds{0}; });
  EXPECT_FALSE(lock.locked());
  EXPECT_EQ(lock.wait(), 0);
  run(50, [] { return std::numeric_limits<Nanoseconds>::max() / 4; });
  EXPECT_FALSE(lock.locked());
  run(50, newest);
  EXPECT_TRUE(lock.locked());
}

TEST(PeriodicLoop, AShiftMovesAllLaterSteps) {
  PeriodicLoop loop(100);
  std::atomic<bool> stop = false;
  std::vector<Nanoseconds> due;
  loop.run(stop, [&](Nanoseconds) {
    due.push_back(loop.due());
    if (due.size() == 2) loop.shift(3'000'000);
    if (due.size() == 5) stop = true;
  });
  // A busy machine may skip steps of the grid.
  EXPECT_EQ((due[1] - due[0]) % 10'000'000, 0);
  EXPECT_EQ((due[2] - due[1]) % 10'000'000, 3'000'000);
  EXPECT_EQ((due[4] - due[2]) % 10'000'000, 0);
}

TEST(SimulatedClock, IsRealTimeUntilCommanded) {
  const SimulatedClock clock;
  for (const Nanoseconds t :
       {Nanoseconds{0}, kSecond, 400 * 86400 * kSecond + 1}) {  // beyond the exact integers of a double
    EXPECT_EQ(clock.at(t), t);
    EXPECT_EQ(clock.when(t), t);
  }
  EXPECT_EQ(clock.pace(kSecond), 1);
}

TEST(SimulatedClock, SlowsDownStopsAndResumesWithoutAJump) {
  SimulatedClock clock;
  clock.command(10 * kSecond, 0.25);
  clock.command(14 * kSecond, 0);
  clock.command(20 * kSecond, 1, 22 * kSecond);
  EXPECT_EQ(clock.at(10 * kSecond), 10 * kSecond);
  EXPECT_EQ(clock.at(12 * kSecond), 10 * kSecond + kSecond / 2);
  EXPECT_EQ(clock.at(17 * kSecond), 11 * kSecond);
  EXPECT_EQ(clock.at(21 * kSecond), 12 * kSecond);
  EXPECT_EQ(clock.at(99 * kSecond), 13 * kSecond);
  EXPECT_EQ(clock.pace(11 * kSecond), 0.25);
  EXPECT_EQ(clock.pace(21 * kSecond), 1);
  EXPECT_EQ(clock.pace(22 * kSecond), 0);
  EXPECT_EQ(clock.when(9 * kSecond), 9 * kSecond);
  EXPECT_EQ(clock.when(10 * kSecond + kSecond / 2), 12 * kSecond);
  EXPECT_EQ(clock.when(11 * kSecond), 14 * kSecond);  // at the earliest
  EXPECT_EQ(clock.when(12 * kSecond), 21 * kSecond);
  EXPECT_EQ(clock.when(13 * kSecond + 1), SimulatedClock::kNever);
  Nanoseconds last = 0;
  for (Nanoseconds t = 9 * kSecond; t < 24 * kSecond; t += 1'234'567) {
    EXPECT_GE(clock.at(t), last);
    EXPECT_LE(clock.at(t) - last, last == 0 ? t : 1'234'568);
    last = clock.at(t);
    EXPECT_LE(clock.when(last), t + 4);
  }
}

TEST(SimulatedClock, DoesNotDependOnTheOrderOfCommandsAndRoundTripsAsText) {
  struct Command {
    Nanoseconds from;
    double pace;
    Nanoseconds until;
  };
  std::vector<Command> commands{{5 * kSecond, 0.1, SimulatedClock::kNever},
                                {6 * kSecond, 1, 6 * kSecond + 7},
                                {8 * kSecond, 1.0 / 3, SimulatedClock::kNever}};
  SimulatedClock ordered;
  for (const Command& c : commands) ordered.command(c.from, c.pace, c.until);
  ASSERT_NE(ordered.at(9 * kSecond), 9 * kSecond);
  for (const std::array<std::size_t, 3>& order : {std::array<std::size_t, 3>{2, 1, 0}, {1, 2, 0}, {2, 0, 1}}) {
    SimulatedClock clock;
    for (const std::size_t i : order) clock.command(commands[i].from, commands[i].pace, commands[i].until);
    for (Nanoseconds t = 4 * kSecond; t < 12 * kSecond; t += 76'543'211) EXPECT_EQ(clock.at(t), ordered.at(t));
  }
  const SimulatedClock parsed = SimulatedClock::from_text(ordered.text());
  for (Nanoseconds t = 4 * kSecond; t < 12 * kSecond; t += 76'543'211) EXPECT_EQ(parsed.at(t), ordered.at(t));
  for (const char* wrong : {"", "now", "1 2", "0 0 7 5", "0 0 1 9223372036854775807 3"})
    EXPECT_THROW(SimulatedClock::from_text(wrong), std::invalid_argument) << wrong;
}

TEST(SimulatedClock, RemembersEnoughCommandsOfALongSession) {
  SimulatedClock clock;
  Nanoseconds expected = kSecond;
  for (int i = 1; i <= 100; ++i) {
    clock.command(i * kSecond, i % 2 == 1 ? 0.5 : 1);
    if (i > 1) expected += i % 2 == 1 ? kSecond : kSecond / 2;  // the second that just ended
    EXPECT_EQ(clock.at(i * kSecond), expected);
  }
}

TEST(PeriodicLoop, FollowsASlowedClockAndStopsWithIt) {
  auto loop = std::make_unique<PeriodicLoop>(500);
  std::atomic<bool> stop{false};
  SimulatedClock clock;
  const Nanoseconds begin = now();
  clock.command(begin + kSecond / 10, 0.25);
  clock.command(begin + kSecond / 2, 0);
  std::vector<Nanoseconds> steps;
  int betweens = 0;
  loop->run(
      stop, clock, [&](Nanoseconds time) { steps.push_back(time); },
      [&](Nanoseconds real) {
        ++betweens;
        stop = real > begin + kSecond;
      });
  // 50 steps at full pace, 50 in the 400 ms at a quarter, none in the half second after. Fewer if the machine is late.
  EXPECT_LE(steps.size(), 102u);
  EXPECT_GE(steps.size(), 60u);
  EXPECT_LE(steps.back(), begin + kSecond / 5);
  EXPECT_TRUE(std::is_sorted(steps.begin(), steps.end()));
  EXPECT_GE(betweens, static_cast<int>(steps.size()) + 15);
}

TEST(PeriodicLoop, ReportsZeroRateWhileTheClockStands) {
  auto loop = std::make_unique<PeriodicLoop>(500);
  std::atomic<bool> stop{false};
  SimulatedClock clock;
  const Nanoseconds begin = now();
  clock.command(begin + kSecond / 5, 0);
  LoopStatus status;
  double rate = 0;
  loop->run(
      stop, clock, [](Nanoseconds) {},
      [&](Nanoseconds real) {
        loop->fill(status);
        rate = std::max(rate, status.rate_hz);
        stop = real > begin + 3 * kSecond / 2;
      });
  EXPECT_GT(rate, 300);
  EXPECT_EQ(status.rate_hz, 0);
  EXPECT_EQ(status.step_ms_p99, 0);
}

TEST(Scheduling, CoresAreAListOfNumbersAndRanges) {
  const auto numbers = [](const std::string& text) {
    const cpu_set_t cores = parse_cores(text);
    std::vector<int> found;
    for (int core = 0; core < CPU_SETSIZE; ++core)
      if (CPU_ISSET(core, &cores)) found.push_back(core);
    return found;
  };
  EXPECT_EQ(numbers("2"), (std::vector{2}));
  EXPECT_EQ(numbers("0-2,5"), (std::vector{0, 1, 2, 5}));
  EXPECT_EQ(numbers("7,3-3"), (std::vector{3, 7}));
  for (const char* wrong : {"", "a", "1,", ",1", "3-1", "1-", "-1", "1 2", "99999", "1;2"})
    EXPECT_THROW(parse_cores(wrong), std::invalid_argument) << wrong;
}

// A thread that a loop starts at any time is ordinary. This test needs permission for real-time priority.
TEST(Scheduling, ThreadsOfALoopAreOrdinary) {
  std::thread([] {
    const auto warnings = request_real_time(3);
    if (sched_getscheduler(0) == SCHED_OTHER) GTEST_SKIP() << warnings.back();
    EXPECT_EQ(sched_getscheduler(0) & ~SCHED_RESET_ON_FORK, SCHED_FIFO);
    std::thread([] { EXPECT_EQ(sched_getscheduler(0) & ~SCHED_RESET_ON_FORK, SCHED_OTHER); }).join();
  }).join();
}

int niceness_of_a_new_thread() {
  int niceness = 0;
  std::thread([&niceness] { niceness = getpriority(PRIO_PROCESS, 0); }).join();
  return niceness;
}

// The threads that receive samples. Without permission there is a warning, and new threads stay as they were.
TEST(Scheduling, ThreadsAreFavouredUntilTheLoopIsRealTime) {
  std::thread([] {
    const int before = niceness_of_a_new_thread();
    bool is_permitted = false;
    std::thread([&is_permitted] { is_permitted = setpriority(PRIO_PROCESS, 0, -15) == 0; }).join();
    EXPECT_EQ(favour_new_threads().empty(), is_permitted);
    const int favoured = is_permitted ? -15 : before;
    EXPECT_EQ(niceness_of_a_new_thread(), favoured);
    const bool is_real_time = request_real_time(3).empty();
    EXPECT_EQ(niceness_of_a_new_thread(), is_real_time || is_permitted ? 0 : before);
  }).join();
}

// Takes the permission for real-time priority and negative niceness from the calling thread.
void drop_sys_nice() {
  // What the user may have without the capability. Nobody else in this process needs it.
  rlimit real_time{};
  ASSERT_EQ(getrlimit(RLIMIT_RTPRIO, &real_time), 0);
  real_time.rlim_cur = 0;
  ASSERT_EQ(setrlimit(RLIMIT_RTPRIO, &real_time), 0);
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  __user_cap_data_struct data[2];
  ASSERT_EQ(syscall(SYS_capget, &header, data), 0);
  data[0].effective &= ~(1u << CAP_SYS_NICE);
  ASSERT_EQ(syscall(SYS_capset, &header, data), 0);
}

// The system permits the niceness and refuses the real-time priority.
TEST(Scheduling, HelperThreadsOfARefusedLoopAreOrdinary) {
  std::thread([] {
    if (!favour_new_threads().empty()) GTEST_SKIP() << "negative niceness is not permitted";
    drop_sys_nice();
    std::thread([] {
      become_ordinary();
      EXPECT_EQ(getpriority(PRIO_PROCESS, 0), 0);
    }).join();
    ASSERT_FALSE(request_real_time(3).empty());
    EXPECT_EQ(getpriority(PRIO_PROCESS, 0), -15) << "the loop itself keeps what it has";
    EXPECT_EQ(niceness_of_a_new_thread(), 0);
  }).join();
}

}  // namespace
}  // namespace softhand::runtime_loop_test
