// The offset of another host's clock, with drift and delays that differ in both directions.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <random>

#include "runtime/clock_offset.hpp"

namespace softhand::runtime_clock_offset_test {
namespace {

constexpr double kHour = 3600;
constexpr double kStart = 20000;  // s, our clock

Nanoseconds ns(double seconds) { return static_cast<Nanoseconds>(std::llround(seconds * 1e9)); }

/// Two clocks, and messages between them at 5 Hz.
struct Exchange {
  double offset = kHour;      // s, ours minus theirs, at kStart
  double drift = 50e-6;       // s/s
  double there_most = 0.001;  // s, delays of messages from here are between the least and the most
  double back_most = 0.001;   // s
  double least = 0.00005;     // s
  double loss = 0;
  std::mt19937 random{7};
  ClockOffset estimator;
  double time = kStart;

  double truth(double at) const { return offset + drift * (at - kStart); }
  Nanoseconds theirs(double at) const { return ns(at) - ns(truth(at)); }
  double delay(double most) { return std::uniform_real_distribution<double>(least, most)(random); }
  bool is_lost() { return std::uniform_real_distribution<double>(0, 1)(random) < loss; }

  void step() {
    const double there = delay(there_most), back = delay(back_most);
    if (!is_lost()) estimator.answered(ns(time), theirs(time + there));
    if (!is_lost()) estimator.heard(theirs(time + 0.1), ns(time + 0.1 + back));
    time += 0.2;
  }
  /// Runs for `seconds`. Each estimate must contain the truth. Returns the last uncertainty, s.
  double run(double seconds) {
    double uncertainty = std::numeric_limits<double>::infinity();
    for (const double end = time + seconds; time < end;) {
      step();
      const auto estimate = estimator.at(ns(time));
      if (!estimate) continue;
      const double error = std::abs(static_cast<double>(estimate->offset - ns(truth(time)))) * 1e-9;
      EXPECT_LE(error, estimate->uncertainty) << "after " << time - kStart << " s";
      uncertainty = estimate->uncertainty;
    }
    return uncertainty;
  }
};

TEST(ClockOffset, IsUnknownUntilMessagesWentBothWays) {
  ClockOffset estimator;
  EXPECT_FALSE(estimator.at(ns(1)));
  estimator.heard(ns(1), ns(5));
  EXPECT_FALSE(estimator.at(ns(5)));
  estimator.answered(ns(5), ns(1.001));
  const auto estimate = estimator.at(ns(5));
  ASSERT_TRUE(estimate);
  EXPECT_NEAR(static_cast<double>(estimate->offset) * 1e-9, 4, 1e-3);
  EXPECT_NEAR(estimate->uncertainty, 0.5e-3, 0.1e-3);
}

TEST(ClockOffset, IsWithinItsUncertaintyWithDriftAndJitter) {
  for (const double drift : {50e-6, -50e-6, 0.0, 300e-6}) {
    Exchange exchange;
    exchange.drift = drift;
    const double uncertainty = exchange.run(60);
    const auto estimate = exchange.estimator.at(ns(exchange.time));
    std::printf("delays to 1 ms, drift %+4.0f ppm: uncertainty %.3f ms, drift estimated %+.1f ppm\n", 1e6 * drift,
                1e3 * uncertainty, 1e6 * estimate->drift);
    EXPECT_LT(uncertainty, 0.25e-3);
    EXPECT_NEAR(estimate->drift, drift, 20e-6);
  }
}

TEST(ClockOffset, WithstandsLongDelaysLossAndAsymmetry) {
  Exchange exchange;
  exchange.there_most = exchange.back_most = 0.05;
  exchange.loss = 0.05;
  const double jittered = exchange.run(60);
  std::printf("delays to 50 ms, 5 %% lost: uncertainty %.3f ms\n", 1e3 * jittered);
  EXPECT_LT(jittered, 5e-3);

  Exchange asymmetric;
  asymmetric.least = asymmetric.there_most = 0.03;
  asymmetric.back_most = 0.031;
  const double uncertainty = asymmetric.run(30);
  EXPECT_GT(uncertainty, 0.029) << "half of what nobody can know";
}

TEST(ClockOffset, LosesItsAccuracySlowlyWhenTheCableIsCut) {
  Exchange exchange;
  const double before = exchange.run(30);
  for (const double cut : {1.0, 10.0, 100.0}) {
    const auto estimate = exchange.estimator.at(ns(exchange.time + cut));
    ASSERT_TRUE(estimate);
    const double truth = exchange.truth(exchange.time + cut);
    EXPECT_LE(std::abs(static_cast<double>(estimate->offset - ns(truth))) * 1e-9, estimate->uncertainty);
    EXPECT_GT(estimate->uncertainty, before);
    EXPECT_LT(estimate->uncertainty, before + 60e-6 * cut);
  }
}

TEST(ClockOffset, FollowsAClockThatWasSet) {
  Exchange exchange;
  exchange.run(30);
  exchange.offset += 2;
  exchange.step();
  const auto estimate = exchange.estimator.at(ns(exchange.time));
  if (estimate) {
    EXPECT_NEAR(static_cast<double>(estimate->offset) * 1e-9, exchange.truth(exchange.time), 2e-3);
  }
  EXPECT_LT(exchange.run(30), 0.25e-3);
}

// The estimate assumes that the rate of a clock changes slowly. For some seconds a sudden change is seen as noise.
TEST(ClockOffset, FollowsAClockWhoseRateWasChanged) {
  Exchange exchange;
  exchange.run(30);
  exchange.drift += 100e-6;
  exchange.offset -= 100e-6 * (exchange.time - kStart);
  double worst = 0;
  for (int i = 0; i < 100; ++i) {
    exchange.step();
    const auto estimate = exchange.estimator.at(ns(exchange.time));
    ASSERT_TRUE(estimate);
    worst = std::max(worst, std::abs(static_cast<double>(estimate->offset - ns(exchange.truth(exchange.time)))) * 1e-9);
  }
  std::printf("rate changed by 100 ppm: largest error %.3f ms in the first 20 s\n", 1e3 * worst);
  EXPECT_LT(worst, 0.5e-3);
  EXPECT_LT(exchange.run(30), 0.25e-3);
}

TEST(ClockOffset, AnyStampIsSafe) {
  constexpr Nanoseconds kFirst = std::numeric_limits<Nanoseconds>::min();
  constexpr Nanoseconds kLast = std::numeric_limits<Nanoseconds>::max();
  for (const Nanoseconds a : {kFirst, Nanoseconds{0}, ClockOffset::kLatest, kLast}) {
    for (const Nanoseconds b : {kFirst, Nanoseconds{0}, ClockOffset::kLatest, kLast}) {
      ClockOffset estimator;
      estimator.heard(a, b);
      estimator.answered(b, a);
      estimator.heard(b, a);
      estimator.at(ns(kStart));
    }
  }
}

}  // namespace
}  // namespace softhand::runtime_clock_offset_test
