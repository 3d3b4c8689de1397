// Statistics, schedule and loop.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "runtime/periodic_loop.hpp"
#include "runtime/statistics.hpp"

namespace softhand {
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

TEST(RollingHistogram, ForgetsWhatIsOlderThanASecond) {
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

TEST(RollingHistogram, TakesTheExtremes) {
  auto histogram = std::make_unique<RollingHistogram>();
  for (Nanoseconds x = 0; x < 70; ++x) {  // single buckets, then pairs
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
  schedule.advance(schedule.due() + 10);  // ended just when the next is due
  EXPECT_EQ(schedule.misses(), 0u);
}

TEST(Schedule, OneLateStepNeverASpiral) {
  Schedule schedule(0, 10);
  schedule.advance(2004);  // a stall of 200 periods: 10 to 2000 were missed
  EXPECT_EQ(schedule.misses(), 200u);
  EXPECT_EQ(schedule.due(), 2000);  // one late step at once
  schedule.advance(2006);
  EXPECT_EQ(schedule.due(), 2010);  // and on with the grid
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

TEST(PeriodicLoop, RefusesRatesThatCannotBe) {
  for (const double rate : {0.0, -1.0, 1e9, std::nan(""), HUGE_VAL}) EXPECT_THROW(PeriodicLoop{rate}, std::invalid_argument) << rate;
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
  for (std::size_t i = 0; i < starts.size(); ++i) EXPECT_GE(starts[i] - begin, static_cast<Nanoseconds>(i) * 2'000'000) << i;
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
  EXPECT_GE(now() - begin, 54'000'000);  // 4 periods, the stall, and the grid after it
  EXPECT_GE(loop->deadline_misses(), 49u);
  EXPECT_GE(loop->step_times().quantile(1), 49'000'000);
}

}  // namespace
}  // namespace softhand
