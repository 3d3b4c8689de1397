// softhand-tracker-openxr with the real loader and a runtime of our own: a headset that comes late, leaves and comes
// back, hands that are not seen or are no hands, and the latency that the tracker adds.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "device/health.hpp"
#include "runtime/clock.hpp"
#include "support/tracker_process.hpp"

namespace softhand {
namespace {

class OpenXrProcess : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { testing::use_own_domain(); }
  OpenXrProcess() { setenv("FAKE_OPENXR", file_.c_str(), 1); }
  ~OpenXrProcess() override { std::filesystem::remove(file_); }
  void start(const std::string& manifest) {
    setenv("XR_RUNTIME_JSON", manifest.c_str(), 1);
    tracker_ = std::make_unique<testing::Process>(
        "softhand-tracker-openxr",
        std::vector<std::string>{"--config", std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml", "--set",
                                 "tracker_openxr.rate=120", "--source", "9"},
        true);
  }
  void headset(const std::string& state) const {
    // At once, so that no half of a word is read.
    std::ofstream(file_ + ".new") << state;
    std::filesystem::rename(file_ + ".new", file_);
  }

  const std::string file_ = ::testing::TempDir() + "softhand_openxr_" + std::to_string(getpid());
  testing::TrackerListener listener_;
  std::unique_ptr<testing::Process> tracker_;
};

TEST_F(OpenXrProcess, FollowsAHeadsetThroughPowerCycles) {
  start(OPENXR_MANIFEST);
  EXPECT_TRUE(listener_.until_health(Health::opening));
  EXPECT_EQ(listener_.counter("connections"), 0);
  for (const char* end : {"", "lost"}) {
    headset("worn");
    ASSERT_TRUE(listener_.until_health(Health::live));
    ASSERT_TRUE(listener_.until_hands(9, true));
    EXPECT_NEAR(listener_.head.position[1], 1.6, 1e-6);
    for (std::size_t side = 0; side < 2; ++side) {
      const Skeleton& hand = listener_.hands[side];
      // The left hand holds a controller.
      EXPECT_EQ(hand.confidence, side == 0 ? 0.5 : 1.0);
      for (const JointSample& joint : hand.joints) {
        EXPECT_EQ(joint.flags, kJointValid | (side == 0 ? kJointInferred : kJointTracked));
        EXPECT_NEAR(joint.radius, 0.009, 1e-6);
        EXPECT_EQ(joint.velocity_valid, 1u);
      }
      // Where the runtime has the hand at the time of the sample.
      const double sway = 0.05 * std::sin(static_cast<double>(hand.stamp.sample_time) * 1e-9);
      EXPECT_NEAR(hand.joints[1].position[0], (side == 0 ? -0.2 : 0.2) + sway, 1e-6);
      EXPECT_LE(hand.stamp.sample_time, hand.stamp.publish_time);
    }
    headset("not worn");
    ASSERT_TRUE(listener_.until([] {}, [&] { return listener_.counter("confidence") == 0; }));
    EXPECT_EQ(listener_.counter("health"), static_cast<double>(Health::live));
    // The headset is switched off, or its session is stopped.
    if (*end == '\0') {
      std::filesystem::remove(file_);
    } else {
      headset(end);
    }
    ASSERT_TRUE(listener_.until([] {}, [&] { return listener_.counter("connections") == 0; })) << end;
    std::filesystem::remove(file_);
    ASSERT_TRUE(listener_.until_health(Health::lost)) << end;
  }
  headset("worn");
  ASSERT_TRUE(listener_.until_health(Health::live));
  EXPECT_GE(listener_.counter("reconnects"), 2);
  EXPECT_EQ(listener_.counter("refused_content") + listener_.counter("refused_order"), 0);
  const int status = tracker_->end(SIGTERM);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

TEST_F(OpenXrProcess, RefusesHandsThatAreNoHands) {
  headset("nan");
  start(OPENXR_MANIFEST);
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("refused_content") > 10; }));
  EXPECT_EQ(listener_.counter("published"), 0);
  headset("worn");
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("published") > 10; }));
}

TEST_F(OpenXrProcess, LatencyAdded) {
  headset("worn");
  start(OPENXR_MANIFEST);
  // The sample time is the time at which the runtime was asked.
  testing::check_stamped_latency(listener_, "openxr");
}

TEST_F(OpenXrProcess, WaitsForARuntime) {
  start("/nowhere/runtime.json");
  EXPECT_TRUE(listener_.until_health(Health::opening));
  EXPECT_EQ(listener_.counter("connections"), 0);
  const int status = tracker_->end(SIGTERM);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

}  // namespace
}  // namespace softhand
