// Recordings of a hand as CSV.
#include "trackers/replay/recording.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <sstream>
#include <vector>

#include "messages/convert.hpp"
#include "support/moving_hand.hpp"
#include "trackers/replay/replay_tracker.hpp"
#include "unit/opposing_hand.hpp"

namespace softhand::recording_test {
namespace {

constexpr Nanoseconds kMillisecond = 1'000'000;

std::string csv_row(double t, double x) {
  std::ostringstream row;
  row << t;
  for (int j = 0; j < 25; ++j) row << "," << x << "," << 0.01 * j << ",0,0,0,0,1,0.01";
  return row.str() + "\n";
}
std::string error_of(const std::string& text) {
  std::istringstream in(text);
  try {
    Recording::parse(in, "hand.csv");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(Recording, ReadsJointsAndPlacesThePalm) {
  std::istringstream in(testing::recording_header() + csv_row(5, 0.1) + csv_row(5.02, 0.3));
  const Recording recording = Recording::parse(in, "hand.csv");
  EXPECT_EQ(recording.frames().size(), 2u);
  EXPECT_NEAR(recording.duration(), 0.02, 1e-12);
  const JointFrames middle = recording.at(0.005);
  EXPECT_NEAR(middle[slot_of(Joint::wrist)].position.x(), 0.15, 1e-12);
  EXPECT_NEAR(middle[slot_of(Joint::little_tip)].position.y(), 0.24, 1e-12);
  EXPECT_LT((middle[0].position - 0.5 * (middle[11].position + middle[12].position)).norm(), 1e-12);
  EXPECT_NEAR(recording.radii()[slot_of(Joint::index_tip)], 0.01, 1e-12);
}

TEST(Recording, IgnoresAByteOrderMarkBeforeTheHeader) {
  EXPECT_EQ(error_of("\xEF\xBB\xBF" + testing::recording_header() + csv_row(0, 0.1)), "");
}

TEST(Recording, ErrorsNameFileLineColumnAndWhatWasExpected) {
  EXPECT_EQ(error_of(""), "hand.csv:1: expected a header that starts with t_s, got an empty file");
  EXPECT_NE(error_of("t_s,wrist.px\n").find("hand.csv:1: column 'wrist.py': expected, is missing"), std::string::npos);
  EXPECT_NE(error_of("t_s,elbow.px\n").find("hand.csv:1: column 'elbow.px'"), std::string::npos);
  std::string bad = csv_row(1, 0.5);
  bad.replace(bad.find("0.5"), 3, "abc");
  EXPECT_EQ(error_of(testing::recording_header() + csv_row(0, 0) + bad),
            "hand.csv:3: column 'wrist.px': expected a finite number, got 'abc'");
  EXPECT_NE(error_of(testing::recording_header() + csv_row(1, 0) + csv_row(1, 0)).find("hand.csv:3: column 't_s'"),
            std::string::npos);
  EXPECT_NE(error_of(testing::recording_header() + "1,2,3\n").find("hand.csv:2: expected 201 columns, got 3"),
            std::string::npos);
  EXPECT_NE(error_of(testing::recording_header()).find("at least one row"), std::string::npos);
}

TEST(Recording, RecordedHandHasConstantBoneLengths) {
  if (!std::filesystem::exists(testing::recorded_hand_path())) GTEST_SKIP() << "no " << testing::recorded_hand_path();
  const Recording recording = Recording::load(testing::recorded_hand_path());
  EXPECT_EQ(recording.frames().size(), 756u);
  EXPECT_NEAR(recording.start(), 20.4612, 1e-9);
  double sum = 0, square = 0;
  for (const JointFrames& frame : recording.frames()) {
    const double length =
        (frame[slot_of(Joint::index_intermediate)].position - frame[slot_of(Joint::index_proximal)].position).norm();
    sum += length;
    square += length * length;
  }
  const double mean = sum / 756;
  EXPECT_NEAR(mean, 0.040, 0.005);
  EXPECT_LT(std::sqrt(square / 756 - mean * mean), 0.9e-3);
}

// Written with every digit at uneven times, as a headset's frames come. The hand moves in each frame.
TEST(Recording, TheTrackerPlaysEveryFrameAtItsOwnTime) {
  const std::shared_ptr<const Motion> motion = testing::free_motion();
  std::vector<double> times;
  for (int i = 0; i < 200; ++i) times.push_back(0.011 * i + (i % 3 == 1 ? 0.002 : 0));
  std::istringstream in(testing::recording_text(*motion, times));
  const auto recording = std::make_shared<Recording>(Recording::parse(in, "hand.csv"));
  ASSERT_EQ(recording->frames().size(), 200u);
  ReplayTracker tracker(recording, {}, {});
  Skeleton sample;
  std::size_t played = 0;
  for (Nanoseconds now = 0; now < 2'500 * kMillisecond && played < 200; now += kMillisecond) {
    if (!tracker.sample(now, sample)) continue;
    ASSERT_EQ(sample.stamp.sequence, played + 1);
    EXPECT_LT((to_vector(sample.joints[1].position) - motion->at(recording->times()[played])[1].position).norm(),
              1e-12);
    EXPECT_NEAR(static_cast<double>(sample.stamp.sample_time) * 1e-9, recording->times()[played], 1e-9);
    ++played;
  }
  EXPECT_EQ(played, 200u);
}

}  // namespace
}  // namespace softhand::recording_test
