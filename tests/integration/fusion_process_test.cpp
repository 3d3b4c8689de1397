// softhand-tracker-fusion with other processes as its sources, over DDS.
#include <optional>

#include "device/health.hpp"
#include "runtime/exit_codes.hpp"
#include "support/split_hand.hpp"
#include "support/tracker_process.hpp"

namespace softhand::fusion_process_test {
namespace {

class FusionProcess : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { testing::use_own_domain(); }
  static std::vector<std::string> with_scene(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"--config", std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml"});
    return arguments;
  }
  void start(const std::vector<std::string>& arguments) {
    listener_.module = "fusion";
    auto all = with_scene({"--module", "fusion", "--source", "9"});
    all.insert(all.end(), arguments.begin(), arguments.end());
    fusion_.emplace("softhand-tracker-fusion", all, false);
    ASSERT_TRUE(listener_.until([] {}, [&] { return listener_.counter("health") >= 0; }));
  }
  void write(Skeleton sample, Nanoseconds measured) {
    sample.stamp.sample_time = sample.stamp.chain.tracker_sample = measured;
    sample.stamp.publish_time = now();
    sample.stamp.clock_id = clock_id();
    sample.stamp.epoch = sample.hand.user;
    sample.stamp.sequence = ++sequence_;
    writer_.write(sample);
  }

  testing::TrackerListener listener_;
  std::optional<testing::Process> fusion_;
  bus::Writer<Skeleton> writer_{listener_.participant, bus::topics::tracked_skeleton};
  std::uint64_t sequence_ = 0;
};

// In real time: the wrist at 90 Hz, the fingers at 60 Hz and 30 ms late, with dips of confidence. A busy machine can
// keep this test from writing in time. The hand is then another one, so what arrives up to 0.1 s after is not judged.
// Fusion.ComposesARecordedHandThatWasDivided judges the recorded hand, in steps of a time of its own.
TEST_F(FusionProcess, ComposesAHandThatWasDivided) {
  const auto motion = testing::shipped_free_motion();
  constexpr double kLate = 5e-3, kRecovery = 0.1;  // s
  start({"--set", "tracker_fusion.delay=0.015"});
  std::mt19937_64 random(5);
  testing::TipErrors errors;
  const Nanoseconds begin = now();
  const auto clock_at = [&](double time) { return begin + static_cast<Nanoseconds>(time * 1e9); };
  double next_wrist = 0, next_fingers = 0, time = 0, judged_from = 0.5;
  while (time < motion->duration()) {
    std::this_thread::sleep_for(std::chrono::microseconds(500));
    time = static_cast<double>(now() - begin) * 1e-9;
    if (time > std::min(next_wrist, next_fingers + testing::kFingerDelay) + kLate)
      judged_from = std::max(judged_from, time + kRecovery);
    if (time >= next_wrist) {
      write(testing::only_wrist(motion->at(next_wrist)), clock_at(next_wrist));
      next_wrist += 1.0 / 90;
    }
    if (time >= next_fingers + testing::kFingerDelay) {
      write(testing::doubtful_fingers(motion->at(next_fingers), next_fingers, random), clock_at(next_fingers));
      next_fingers += 1.0 / 60;
    }
    listener_.skeletons.take_all([&](const Skeleton& hand) {
      if (hand.hand.user != 0 || time < judged_from) return;
      EXPECT_EQ(hand.source, 9u);
      errors.add(hand, motion->at(static_cast<double>(hand.stamp.sample_time - begin) * 1e-9));
    });
  }
  ASSERT_TRUE(listener_.until([] {}, [&] { return listener_.counter("poor") >= 10; }));
  std::printf("fingertips: %.2f mm RMS, %.0f mm at most, %d samples\n", errors.rms() * 1e3, errors.largest() * 1e3,
              errors.samples());
  EXPECT_GT(errors.samples(), 300);
  EXPECT_LT(errors.rms(), 1e-3);
  EXPECT_EQ(listener_.counter("refused"), 0);
}

// Two trackers as processes. The better one of the fingers is killed and started again.
TEST_F(FusionProcess, AnotherTrackerTakesTheFingersOver) {
  const auto tracker = [&](const char* user, const char* motion) {
    return with_scene({"--module", std::string("tracker-") + user, "--user", user, "--set",
                       std::string("generator.motion=") + motion, "--set", "tracker.repeat=true"});
  };
  const testing::Process camera("softhand-tracker-replay", tracker("1", "pinch"), false);
  std::optional<testing::Process> glove;
  glove.emplace("softhand-tracker-replay", tracker("2", "fist"), false);
  start({});
  const auto fingers_from = [&](double user) {
    return listener_.until(
        [] {},
        [&] { return listener_.counter("right_wrist_from") == 1 && listener_.counter("right_fingers_from") == user; });
  };
  ASSERT_TRUE(fingers_from(2));
  glove->end(SIGKILL);
  ASSERT_TRUE(fingers_from(1));
  EXPECT_EQ(listener_.counter("health"), static_cast<double>(Health::live));
  glove.emplace("softhand-tracker-replay", tracker("2", "fist"), false);
  ASSERT_TRUE(fingers_from(2));
  EXPECT_EQ(listener_.hands[1].source, 9u);
  EXPECT_EQ(listener_.counter("left_wrist_from"), -1);
  EXPECT_EQ(fusion_->end(SIGTERM), 0);
}

TEST_F(FusionProcess, LatencyAdded) {
  start({});
  const auto motion = testing::quest_hand();
  testing::check_latency(listener_, "fusion", [&] { write(testing::only_wrist(motion->at(1)), now()); });
}

TEST_F(FusionProcess, RefusesItsOwnHandAsASource) {
  testing::Process fusion("softhand-tracker-fusion", with_scene({"--set", "tracker_fusion.wrist='0'"}), false);
  EXPECT_EQ(WEXITSTATUS(fusion.end(0)), kExitConfiguration);  // it ends by itself
}

}  // namespace
}  // namespace softhand::fusion_process_test
