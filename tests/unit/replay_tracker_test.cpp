// The rate, the latency and the simulated faults of the replay tracker.
#include "trackers/replay/replay_tracker.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "messages/convert.hpp"
#include "unit/opposing_hand.hpp"

namespace softhand::replay_tracker_test {
namespace {

using testing::free_motion;
using testing::opposing_hand;

constexpr Nanoseconds kMillisecond = 1'000'000;

std::vector<Skeleton> play(const ReplayOptions& options, double seconds, Nanoseconds step = kMillisecond) {
  ReplayTracker tracker(free_motion(), options, {3, 0}, 9);
  std::vector<Skeleton> samples;
  Skeleton sample;
  for (Nanoseconds now = 0; now < static_cast<Nanoseconds>(seconds * 1e9); now += step) {
    if (tracker.sample(500 * kMillisecond + now, sample)) samples.push_back(sample);
  }
  return samples;
}

TEST(ReplayTracker, HasTheRequestedRateLatencyAndIdentity) {
  ReplayOptions options;
  options.rate_hz = 60;
  options.latency = 0.03;
  const auto samples = play(options, 2);
  EXPECT_NEAR(static_cast<double>(samples.size()), 60 * 1.97, 1.5);
  EXPECT_EQ(samples[0].hand, (HandKey{3, 0}));
  EXPECT_EQ(samples[0].source, 9u);
  EXPECT_EQ(samples[0].stamp.sample_time, 500 * kMillisecond);
  for (std::size_t i = 1; i < samples.size(); ++i) {
    EXPECT_EQ(samples[i].stamp.sequence, samples[i - 1].stamp.sequence + 1);
    EXPECT_NEAR(static_cast<double>(samples[i].stamp.sample_time - samples[i - 1].stamp.sample_time), 1e9 / 60, 2);
  }
}

TEST(ReplayTracker, NoiseHasTheRequestedSizeAndDoesNotDependOnTheCaller) {
  ReplayOptions clean, noisy;
  clean.rate_hz = noisy.rate_hz = 100;
  noisy.position_noise = 1e-3;
  noisy.rotation_noise = 0.02;
  const auto a = play(clean, 5), b = play(noisy, 5), c = play(noisy, 5, 10 * kMillisecond);
  double square = 0, turn = 0, sum = 0;
  std::size_t count = 0;
  ASSERT_EQ(a.size(), b.size());
  ASSERT_EQ(b.size(), c.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t j = 0; j < kJointCount; ++j) {
      const Vector3 error = to_vector(b[i].joints[j].position) - to_vector(a[i].joints[j].position);
      square += error.squaredNorm();
      sum += error.sum();
      turn += rotation_log(to_quaternion(b[i].joints[j].orientation) *
                           to_quaternion(a[i].joints[j].orientation).conjugate())
                  .squaredNorm();
      count += 3;
      ASSERT_EQ(b[i].joints[j].position, c[i].joints[j].position);
    }
  }
  const auto n = static_cast<double>(count);
  EXPECT_NEAR(std::sqrt(square / n), 1e-3, 3e-5);
  EXPECT_NEAR(std::sqrt(turn / n), 0.02, 6e-4);
  EXPECT_LT(std::abs(sum / n), 2e-5);
}

TEST(ReplayTracker, ARestartBeginsAtItsOwnTime) {
  ReplayOptions options;
  options.rate_hz = 100;
  ReplayTracker punctual(free_motion(), options, {3, 0}, 9), late(free_motion(), options, {3, 0}, 9);
  Skeleton expected, sample;
  punctual.sample(0, expected);
  late.sample(0, sample);
  punctual.restart(1000 * kMillisecond);
  ASSERT_TRUE(punctual.sample(1000 * kMillisecond, expected));
  EXPECT_EQ(expected.stamp.sample_time, 1000 * kMillisecond);
  ASSERT_TRUE(punctual.sample(1400 * kMillisecond, expected));
  late.restart(1000 * kMillisecond);  // 0.4 s later
  ASSERT_TRUE(late.sample(1400 * kMillisecond, sample));
  EXPECT_EQ(sample.stamp.sample_time, 1400 * kMillisecond);
  EXPECT_EQ(sample.stamp.sequence, expected.stamp.sequence);
  for (std::size_t j = 0; j < kJointCount; ++j) EXPECT_EQ(sample.joints[j].position, expected.joints[j].position);
}

TEST(ReplayTracker, FaultsOccurAtTheRequestedTimes) {
  ReplayOptions options;
  options.rate_hz = 100;
  options.teleport_at = 1;
  options.teleport_time = 0.5;
  options.nan_at = 2;
  options.nan_time = 0.25;
  options.freeze_at = 3;
  options.freeze_time = 2;
  options.flip_signs = true;
  const auto clean = play({.rate_hz = 100}, 6);
  const auto samples = play(options, 6);
  EXPECT_EQ(samples.size(), clean.size() - 200);
  int teleported = 0, nans = 0;
  for (const Skeleton& s : samples) {
    const Skeleton& c = clean[static_cast<std::size_t>(s.stamp.sequence - 1)];
    teleported += std::abs(s.joints[1].position[0] - c.joints[1].position[0]) > 9 ? 1 : 0;
    nans += std::isnan(s.joints[slot_of(Joint::index_intermediate)].position[0]) ? 1 : 0;
    EXPECT_TRUE(all_finite(s.joints[slot_of(Joint::index_distal)].position));
    EXPECT_EQ(s.joints[1].orientation[3] * c.joints[1].orientation[3] < 0, s.stamp.sequence % 2 == 0);
  }
  EXPECT_EQ(teleported, 50);
  EXPECT_EQ(nans, 25);
}

TEST(ReplayTracker, PlaysDropoutsAndDuplicatesAndHoldsTheLastPose) {
  ReplayOptions options;
  options.rate_hz = 100;
  options.dropout_period = 1;
  options.dropout_time = 0.3;
  EXPECT_NEAR(static_cast<double>(play(options, 4).size()), 280, 2);
  options.dropout_period = 0;
  options.duplicate = true;
  const auto twice = play(options, 1);
  ASSERT_GT(twice.size(), 190u);
  EXPECT_EQ(twice[0].stamp.sequence, twice[1].stamp.sequence);
  ReplayOptions end;
  end.rate_hz = 100;
  const auto samples = play(end, 12);
  EXPECT_EQ(samples.size(), 1200u);  // continues with the last pose
  EXPECT_EQ(samples[1100].joints[1].position, samples[1199].joints[1].position);
}

}  // namespace
}  // namespace softhand::replay_tracker_test
