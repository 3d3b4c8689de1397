// OpenXR: what a runtime locates becomes hands and a head, and what is no pose is refused.
#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <limits>
#include <string>

#include "messages/convert.hpp"
#include "support/count_allocations.hpp"
#include "support/counters.hpp"
#include "support/tracker_sink.hpp"
#include "trackers/openxr/openxr_hands.hpp"

namespace softhand::openxr_test {
namespace {

constexpr Nanoseconds kMillisecond = 1'000'000;

using Sink = testing::TrackerSamples;

class OpenXr : public ::testing::Test {
 protected:
  // A frame with all joints tracked, joint j at x = j cm.
  OpenXrFrame frame() {
    OpenXrFrame out;
    out.time = (time_ += 11 * kMillisecond);
    out.head.flags = 15;
    out.head.position = {0, 1.6f, 0};
    for (OpenXrHand& hand : out.hands) {
      hand.is_active = true;
      for (std::size_t j = 0; j < kJointCount; ++j) {
        hand.joints[j].flags = 15;
        hand.joints[j].orientation = {0, 0.6f, 0, 0.8f};
        hand.joints[j].position = {0.01f * static_cast<float>(j), 1, -0.3f};
        hand.joints[j].radius = 0.008f;
        hand.velocities[j] = {3, {1, 2, 3}, {4, 5, 6}};
      }
    }
    return out;
  }
  void take(const OpenXrFrame& frame) { decoder_.take({frame.bytes(), time_ + kMillisecond, 1, true}, sink_); }
  double refused(const std::string& name) const {
    LoopStatus status;
    decoder_.refusals().fill_status(status, 0);
    return testing::counter_of(status, "refused_" + name);
  }

  OpenXrDecoder decoder_;
  Sink sink_;
  Nanoseconds time_ = 1'000'000 * kMillisecond;
};

TEST_F(OpenXr, JointsVelocitiesAndRadiiArePassedOn) {
  take(frame());
  ASSERT_EQ(sink_.count, 2);
  ASSERT_EQ(sink_.heads, 1);
  EXPECT_EQ(sink_.newest_head.valid, 1u);
  EXPECT_NEAR(sink_.newest_head.position[1], 1.6, 1e-6);
  for (const Skeleton& hand : sink_.hands) {
    EXPECT_EQ(hand.stamp.sample_time, time_);
    EXPECT_EQ(hand.confidence, 1);
    EXPECT_EQ(hand.frame, 0u);
    for (std::size_t j = 0; j < kJointCount; ++j) {
      const JointSample& joint = hand.joints[j];
      EXPECT_NEAR(joint.position[0], 0.01 * static_cast<double>(j), 1e-6);
      EXPECT_NEAR(joint.orientation[1], 0.6, 1e-6);
      EXPECT_NEAR(joint.radius, 0.008, 1e-6);
      EXPECT_EQ(joint.linear_velocity, (Vec3{1, 2, 3}));
      EXPECT_EQ(joint.angular_velocity, (Vec3{4, 5, 6}));
      EXPECT_EQ(joint.velocity_valid, 1u);
      EXPECT_EQ(joint.flags, kJointValid | kJointTracked);
    }
  }
  EXPECT_EQ(decoder_.refusals().total(), 0u);
}

TEST_F(OpenXr, FlagsSayWhatIsSeen) {
  OpenXrFrame each = frame();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  each.hands[0].is_active = false;  // whatever its joints are
  each.hands[0].joints[3].position[0] = nan;
  each.hands[1].joints[10].flags = 3;  // not tracked: inferred
  each.hands[1].joints[15].flags = 1;  // no position
  each.hands[1].joints[15].position[0] = nan;
  each.hands[1].velocities[4].flags = 1;
  each.head.flags = 0;
  each.head.orientation = {};
  take(each);
  EXPECT_EQ(sink_.hands[0].confidence, 0);
  EXPECT_NEAR(sink_.hands[1].confidence, 24.0 / 26, 1e-12);
  EXPECT_EQ(sink_.hands[1].joints[10].flags, kJointValid | kJointInferred);
  EXPECT_EQ(sink_.hands[1].joints[10].confidence, kGuessedConfidence);
  EXPECT_EQ(sink_.hands[1].joints[9].confidence, 1);
  EXPECT_EQ(sink_.hands[1].joints[15].flags, 0u);
  EXPECT_EQ(sink_.hands[1].joints[4].velocity_valid, 0u);
  EXPECT_EQ(sink_.newest_head.valid, 0u);
  EXPECT_EQ(decoder_.refusals().total(), 0u);
}

TEST_F(OpenXr, AHandThatHoldsAControllerIsInferred) {
  OpenXrFrame each = frame();
  each.hands[0].is_from_controller = true;
  take(each);
  EXPECT_EQ(sink_.hands[0].confidence, 0.5);
  for (const JointSample& joint : sink_.hands[0].joints) {
    EXPECT_EQ(joint.flags, kJointValid | kJointInferred);
    EXPECT_EQ(joint.confidence, kGuessedConfidence);
  }
  EXPECT_EQ(sink_.hands[1].confidence, 1);
}

TEST_F(OpenXr, RefusesWhatIsNoPoseAsAWhole) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto spoilt = [&](const std::function<void(OpenXrFrame&)>& spoil) {
    OpenXrFrame each = frame();
    spoil(each);
    take(each);
  };
  spoilt([&](OpenXrFrame& f) { f.hands[1].joints[25].position[2] = nan; });
  spoilt([&](OpenXrFrame& f) { f.hands[1].joints[25].orientation = {0, 0, 0, 2}; });
  spoilt([&](OpenXrFrame& f) { f.hands[1].joints[25].orientation[0] = nan; });
  spoilt([&](OpenXrFrame& f) { f.hands[1].joints[25].position[2] = 2000; });
  spoilt([&](OpenXrFrame& f) { f.hands[1].joints[25].radius = nan; });
  spoilt([&](OpenXrFrame& f) { f.hands[1].joints[25].radius = 0.5f; });
  spoilt([&](OpenXrFrame& f) { f.hands[1].velocities[25].linear[0] = nan; });
  spoilt([&](OpenXrFrame& f) { f.hands[1].velocities[25].angular[0] = 1e9f; });
  spoilt([&](OpenXrFrame& f) { f.head.orientation = {}; });
  EXPECT_EQ(refused("content"), 9);
  EXPECT_EQ(sink_.count + sink_.heads, 0);
  const OpenXrFrame good = frame();
  take(good);
  take(good);
  EXPECT_EQ(refused("order"), 1);
  EXPECT_EQ(sink_.count, 2);
}

TEST_F(OpenXr, DoesNotAllocate) {
  counting = true;
  for (int i = 0; i < 50; ++i) take(frame());
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_EQ(sink_.count, 100);
}

}  // namespace
}  // namespace softhand::openxr_test
