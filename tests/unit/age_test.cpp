// The age of a stamp: never negative, and absent for the future.
#include "messages/age.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace softhand::age_test {
namespace {

constexpr Nanoseconds kNow = 1'000'000'000'000;
constexpr Nanoseconds kMillisecond = 1'000'000;
constexpr std::uint32_t kOwn = 7;

TEST(Age, IsTheTimeSinceTheStamp) {
  EXPECT_DOUBLE_EQ(*age_of(kNow - 250 * kMillisecond, kNow), 0.25);
  EXPECT_DOUBLE_EQ(*age_of(0, kNow), 1000);
}

TEST(Age, IsZeroWithinTheTolerance) {
  EXPECT_EQ(age_of(kNow, kNow), 0);
  EXPECT_EQ(age_of(kNow + kFutureTolerance, kNow), 0);
  EXPECT_FALSE(age_of(kNow + kFutureTolerance + 1, kNow));
}

TEST(Age, AnyStampOnTheWireIsSafe) {
  EXPECT_FALSE(age_of(std::numeric_limits<Nanoseconds>::max(), kNow));
  EXPECT_GT(*age_of(std::numeric_limits<Nanoseconds>::min(), kNow), 9e9);
}

TEST(Age, OfTheStatusIsMinusOneWithoutASample) {
  EXPECT_EQ(age_ms_of(0, kNow), -1);
  EXPECT_EQ(age_ms_of(kNow + 3600'000 * kMillisecond, kNow), -1);
  EXPECT_DOUBLE_EQ(age_ms_of(kNow - 3 * kMillisecond, kNow), 3);
}

TEST(Age, AStampIsUsableOnlyOnTheClockOfThisHost) {
  Stamp stamp;
  stamp.sample_time = stamp.publish_time = kNow;
  stamp.clock_id = kOwn;
  EXPECT_TRUE(is_usable(stamp, kNow, kOwn));
  stamp.clock_id = 0;
  EXPECT_TRUE(is_usable(stamp, kNow, kOwn));
  stamp.clock_id = kOwn + 1;
  EXPECT_FALSE(is_usable(stamp, kNow, kOwn));
  stamp.clock_id = kOwn;
  stamp.publish_time = kNow + 1000 * kMillisecond;
  EXPECT_FALSE(is_usable(stamp, kNow, kOwn));
  stamp.publish_time = kNow;
  stamp.sample_time = kNow + 1000 * kMillisecond;
  EXPECT_FALSE(is_usable(stamp, kNow, kOwn));
}

}  // namespace
}  // namespace softhand::age_test
