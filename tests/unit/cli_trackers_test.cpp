// What `softhand trackers` says about the trackers of a domain.
#include <gtest/gtest.h>

#include <limits>

#include "cli/tracker_table.hpp"
#include "messages/convert.hpp"

namespace softhand::cli_trackers_test {
namespace {

constexpr Nanoseconds kSecond = 1'000'000'000, kStart = 1000 * kSecond;

LoopStatus status(const char* module, double strength, Health health, double published, Nanoseconds time,
                  std::uint64_t epoch, double user = 0) {
  LoopStatus out;
  set_text(out.module, module);
  out.stamp.publish_time = time;
  out.stamp.epoch = epoch;
  out.input_age_ms = 12;
  add_counter(out, "health", static_cast<double>(health));
  add_counter(out, "published", published);
  add_counter(out, "user", user);
  add_counter(out, "strength", strength);
  add_counter(out, "confidence", 0.75);
  return out;
}
Skeleton hand(std::uint64_t epoch, std::uint32_t side, std::uint32_t user = 0) {
  Skeleton out;
  out.hand = {user, side};
  out.stamp.epoch = epoch;
  return out;
}

TEST(TrackerTable, ListsRatesAndOwners) {
  TrackerTable table;
  EXPECT_EQ(table.text(kStart), "no tracker found on this domain\n");
  for (int i = 0; i <= 20; ++i) {
    const Nanoseconds time = kStart + i * kSecond / 10;
    table.add(status("camera", 1, Health::live, 9 * i, time, 7'000'000'000), time);
    table.add(status("glove", 5, Health::degraded, 20 * i, time, 9'000'000'000), time);
    LoopStatus loop = status("hand", 0, Health::live, 0, time, 3);
    loop.counters.clear();
    table.add(loop, time);
  }
  table.add(hand(7'000'000'003, 1));  // started over three times
  ASSERT_EQ(table.trackers().size(), 2u);
  const TrackerRow& camera = table.trackers().at("camera");
  EXPECT_NEAR(camera.rate_hz, 90, 1e-9);
  EXPECT_NEAR(table.trackers().at("glove").rate_hz, 200, 1e-9);
  EXPECT_EQ(camera.strength, 1);
  EXPECT_EQ(camera.confidence, 0.75);
  EXPECT_TRUE(table.owns("camera"));
  EXPECT_FALSE(table.owns("glove"));
  EXPECT_EQ(table.hands_of("camera"), "the right hand of user 0");
  table.add(hand(9'000'000'000, 1));
  table.add(hand(9'000'000'000, 0));
  EXPECT_FALSE(table.owns("camera"));
  EXPECT_EQ(table.hands_of("glove"), "both hands of user 0");
  const std::string text = table.text(kStart + 2 * kSecond);
  EXPECT_NE(text.find("degraded"), std::string::npos) << text;
  EXPECT_NE(text.find("90.0"), std::string::npos) << text;
  EXPECT_EQ(text.find("gone"), std::string::npos) << text;
  EXPECT_NE(table.text(kStart + 4 * kSecond).find("gone"), std::string::npos);
}

TEST(TrackerTable, FindsTheStrengthThatOwns) {
  TrackerTable table;
  table.add(status("camera", 1, Health::live, 0, kStart, 1), kStart);
  table.add(status("glove", 5, Health::live, 0, kStart, 2'000'000), kStart);
  table.add(status("source", 50, Health::live, 0, kStart, 4'000'000, 2), kStart);  // of another user
  table.add(status("dead", 70, Health::live, 0, kStart - 5 * kSecond, 6'000'000), kStart);
  EXPECT_EQ(table.strength_to_own("camera", kStart), 6);
  EXPECT_EQ(table.strength_to_own("glove", kStart), 5);
  EXPECT_EQ(table.strength_to_own("source", kStart), 50);
  EXPECT_FALSE(table.strength_to_own("dead", kStart));
  EXPECT_FALSE(table.strength_to_own("nobody", kStart));
}

// Any process may publish a status. A conversion of such a number has no defined result.
TEST(TrackerTable, RefusesNumbersThatNoTrackerHas) {
  const double nan = std::numeric_limits<double>::quiet_NaN(), huge = 1e300;
  TrackerTable table;
  table.add(status("a", nan, Health::live, 0, kStart, 1), kStart);
  table.add(status("b", huge, Health::live, 0, kStart, 1), kStart);
  table.add(status("c", -1, Health::live, 0, kStart, 1), kStart);
  table.add(status("d", 1, Health::live, nan, kStart, 1), kStart);
  table.add(status("e", 1, Health::live, 0, kStart, 1, nan), kStart);
  table.add(status("f", 1, Health::live, 0, kStart, 1, huge), kStart);
  table.add(status("g", 1, Health::live, 0, kStart, 1, -1), kStart);
  for (const char* name : {"health", "confidence"}) {
    LoopStatus wrong = status(name, 1, Health::live, 0, kStart, 1);
    for (NamedValue& counter : wrong.counters)
      if (get_text(counter.name) == name) counter.value = nan;
    table.add(wrong, kStart);
  }
  EXPECT_TRUE(table.trackers().empty()) << table.text(kStart);
  table.add(status("ordinary", strength_of(kMostStrength, Health::live), Health::live, 0, kStart, 1, 15), kStart);
  EXPECT_EQ(table.trackers().size(), 1u);
}

TEST(MotionStart, IsATimeOrNothing) {
  const auto start = [](double seconds) {
    LoopStatus out;
    add_counter(out, "motion_start_s", seconds);
    return motion_start_of(out);
  };
  EXPECT_EQ(start(1.5), kSecond * 3 / 2);
  EXPECT_EQ(start(-1), -kSecond) << "before the start of the machine";
  const double infinite = std::numeric_limits<double>::infinity();
  for (const double wrong : {std::numeric_limits<double>::quiet_NaN(), infinite, -infinite, 1e300})
    EXPECT_FALSE(start(wrong)) << wrong;
  EXPECT_FALSE(motion_start_of({}));
}

TEST(TrackerTable, AHealthyTrackerIsStrongerThanAllOthers) {
  EXPECT_GT(strength_of(0, Health::live), strength_of(kMostStrength, Health::degraded));
  EXPECT_GT(strength_of(0, Health::opening), strength_of(kMostStrength, Health::lost));
  EXPECT_GT(strength_of(2, Health::live), strength_of(1, Health::live));
  EXPECT_GT(strength_of(2, Health::lost), strength_of(1, Health::degraded));
}

}  // namespace
}  // namespace softhand::cli_trackers_test
