// VMC and OSC trackers: packets to the byte, hands of a performer, and malformed packets.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "messages/convert.hpp"
#include "support/count_allocations.hpp"
#include "support/counters.hpp"
#include "support/moving_hand.hpp"
#include "support/tracker_sink.hpp"
#include "trackers/osc/performer.hpp"
#include "trackers/osc/simulated_performer.hpp"

namespace softhand::osc_test {
namespace {

using testing::Deviations;

constexpr Nanoseconds kMillisecond = 1'000'000;

HandModel shipped_hand() { return load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json"); }

using Sink = testing::TrackerSamples;

class Osc : public ::testing::Test {
 protected:
  void send(const std::string& packet) {
    arrival_ += kMillisecond;
    decoder_.take({packet, arrival_, 0, false}, sink_);
  }
  void send(const std::vector<std::string>& packets) {
    for (const std::string& packet : packets) send(packet);
  }
  Deviations follow(const testing::MovingHand& moving);
  double refused(const std::string& name) const {
    LoopStatus status;
    decoder_.refusals().fill_status(status, 0);
    return testing::counter_of(status, "refused_" + name);
  }
  std::vector<std::string> frame(double time = 1) const {
    return performer_frame(time, {Vector3(0.3, 0, -0.2), Quaternion(Eigen::AngleAxisd(1, Vector3::UnitY()))},
                           {Vector3(0, 1.6, 0), Quaternion::Identity()},
                           {mirrored(hand_).rest_joints, hand_.rest_joints});
  }

  HandModel hand_ = shipped_hand();
  PerformerDecoder decoder_{hand_, OscOptions{.left_tracker = 3, .right_tracker = 2}};
  Sink sink_;
  Nanoseconds arrival_ = 1'000'000 * kMillisecond;
};

TEST_F(Osc, ReadsABoneMessageToTheByte) {
  // Address padded to 20 bytes, types to 12, name to 12, seven big-endian floats.
  const char bytes[] =
      "/VMC/Ext/Bone/Pos\0\0\0"
      ",sfffffff\0\0\0"
      "LeftHand\0\0\0\0"
      "\x3f\x80\0\0\x40\0\0\0\xc0\x40\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x3f\x80\0";
  const std::string packet(bytes, 72);
  EXPECT_EQ(packet, osc_message("/VMC/Ext/Bone/Pos", "LeftHand", {1, 2, -3, 0, 0, 0, 1}));
  int count = 0;
  ASSERT_TRUE(read_osc(packet, [&](const OscMessage& message) {
    ++count;
    EXPECT_EQ(message.address, "/VMC/Ext/Bone/Pos");
    EXPECT_EQ(message.text, "LeftHand");
    ASSERT_EQ(message.count, 7u);
    EXPECT_EQ(message.numbers[1], 2);
    EXPECT_EQ(message.numbers[2], -3);
    EXPECT_EQ(message.numbers[6], 1);
  }));
  EXPECT_EQ(count, 1);
  const auto nothing = [](const OscMessage&) { ADD_FAILURE(); };
  for (std::size_t size = 0; size < packet.size(); ++size)
    EXPECT_FALSE(read_osc(packet.substr(0, size), nothing)) << size;
  EXPECT_FALSE(read_osc(packet + std::string(4, '\0'), nothing));
  EXPECT_FALSE(read_osc(packet + packet, nothing));
}

TEST_F(Osc, ReadsNestedBundlesAndAllTypesOrNothing) {
  const std::string one = osc_message("/a", "", {1}), two = osc_message("/b", "x", {});
  std::string other;
  osc_detail::add_text(other, "/c");
  osc_detail::add_text(other, ",ihdtbTFNIf");
  other += std::string(28, '\1');
  osc_detail::add_word(other, 5);
  other += std::string(8, '\0');
  osc_detail::add_word(other, 0x40000000);
  std::vector<std::string> seen;
  const auto note = [&](const OscMessage& message) {
    seen.emplace_back(message.address);
    if (message.address == "/c") {
      ASSERT_EQ(message.count, 1u);
      EXPECT_EQ(message.numbers[0], 2);
    }
  };
  EXPECT_TRUE(read_osc(osc_bundle({one, osc_bundle({two, other}), one}), note));
  EXPECT_EQ(seen, (std::vector<std::string>{"/a", "/b", "/c", "/a"}));
  seen.clear();
  EXPECT_FALSE(read_osc(osc_bundle({one, two.substr(0, 5)}), note));
  std::string large = osc_bundle({one});
  large[19] = 100;
  EXPECT_FALSE(read_osc(large, note));
  std::string deep = one;
  for (int i = 0; i < 4; ++i) deep = osc_bundle({deep});
  EXPECT_TRUE(read_osc(deep, [](const OscMessage&) {}));
  EXPECT_FALSE(read_osc(osc_bundle({deep}), note));
  EXPECT_TRUE(seen.empty());
}

TEST_F(Osc, APerformersFrameIsTwoHandsAndAHead) {
  for (const bool is_bundle : {false, true}) {
    sink_ = Sink{};
    if (is_bundle) {
      send(osc_bundle(frame()));
    } else {
      send(frame());
    }
    EXPECT_EQ(sink_.count, 2) << is_bundle;
    EXPECT_EQ(sink_.heads, 1);
    EXPECT_NEAR(sink_.newest_head.position[1], 1.6, 1e-6);
    const std::array<HandModel, 2> hands{mirrored(hand_), hand_};
    for (std::size_t side = 0; side < 2; ++side) {
      for (std::size_t j = 0; j < kJointCount; ++j) {
        const Pose seen = softhand::to_pose(sink_.hands[side].joints[j]), &real = hands[side].rest_joints[j];
        EXPECT_LT((seen.position - real.position).norm(), 0.004) << side << kJointNames[j];
        EXPECT_LT(seen.orientation.angularDistance(real.orientation), 12 * M_PI / 180) << side << kJointNames[j];
      }
      EXPECT_EQ(sink_.hands[side].joints[slot_of(Joint::index_tip)].flags, kJointValid | kJointInferred);
      EXPECT_EQ(sink_.hands[side].joints[slot_of(Joint::index_distal)].flags, kJointValid | kJointTracked);
    }
  }
  EXPECT_EQ(decoder_.refusals().total(), 0u);
}

Deviations Osc::follow(const testing::MovingHand& moving) {
  PerformerDecoder decoder(moving.hand, OscOptions{});
  Deviations deviations;
  for (const JointFrames& sent : moving.frames) {
    const auto packet = osc_bundle(performer_frame(0, Pose{}, Pose{}, {sent, sent}));
    arrival_ += kMillisecond;
    decoder.take({packet, arrival_, 0, false}, sink_);
    for (std::size_t j = 0; j < kJointCount; ++j)
      deviations.add(j, softhand::to_pose(sink_.hands[1].joints[j]), sent[j]);
  }
  EXPECT_EQ(decoder.refusals().total(), 0u);
  deviations.print("performer");
  return deviations;
}

TEST_F(Osc, FollowsAGeneratedHand) {
  Deviations deviations = follow(testing::generated_hand(hand_));
  EXPECT_LT(deviations.distance(1), 0.01);
  EXPECT_LT(deviations.turn(1), 0.1);
}

TEST_F(Osc, FollowsARecordedHand) {
  if (!std::filesystem::exists(testing::recorded_hand_path())) GTEST_SKIP() << "no " << testing::recorded_hand_path();
  Deviations deviations = follow(testing::recorded_hand(hand_));
  EXPECT_LT(deviations.distance(0.5), 1);
  EXPECT_LT(deviations.distance(0.99), 18);
  EXPECT_LT(deviations.turn(0.5), 3);
}

TEST_F(Osc, AFrameWithoutSomeBonesIsRefused) {
  std::vector<std::string> lossy = frame(1);
  lossy.erase(lossy.end() - 3);
  send(lossy);
  EXPECT_EQ(sink_.count, 1);  // the left hand
  send(frame(2));
  EXPECT_EQ(refused("incomplete"), 1);
  EXPECT_EQ(sink_.count, 3);
}

TEST_F(Osc, TrackersAreWristsAndAHead) {
  const auto tracker = [&](const std::string& name, double x, std::vector<double> degrees) {
    send(osc_message("/tracking/trackers/" + name + "/position", "", {x, 1, 2}));
    send(osc_message("/tracking/trackers/" + name + "/rotation", "", degrees));
  };
  tracker("2", 0.5, {0, 90, 0});
  ASSERT_EQ(sink_.count, 1);
  const JointSample& wrist = sink_.hands[1].joints[slot_of(Joint::wrist)];
  EXPECT_EQ(wrist.flags, kJointValid | kJointTracked);
  EXPECT_EQ(sink_.hands[1].joints[slot_of(Joint::palm)].flags, 0u);
  EXPECT_LT((to_vector(wrist.position) - Vector3(0.5, 1, -2)).norm(), 1e-6);
  // A quarter turn about Unity's Y takes its forward axis to its right, which is our right.
  EXPECT_LT((to_quaternion(wrist.orientation) * Vector3(0, 0, -1) - Vector3(1, 0, 0)).norm(), 1e-6);
  // Pitch by 30 degrees after a roll by 90: Unity's forward axis points down, whatever the roll.
  tracker("3", 0.5, {30, 0, 90});
  EXPECT_LT((to_quaternion(sink_.hands[0].joints[slot_of(Joint::wrist)].orientation) * Vector3(0, 0, -1) -
             Vector3(0, -0.5, -std::sqrt(0.75)))
                .norm(),
            1e-6);
  // The roll turns Unity's up axis to its left.
  EXPECT_LT(
      (to_quaternion(sink_.hands[0].joints[slot_of(Joint::wrist)].orientation) * Vector3(0, 1, 0) - Vector3(-1, 0, 0))
          .norm(),
      1e-6);
  tracker("4", 0, {0, 0, 0});  // no wrist
  tracker("head", 0, {0, 0, 0});
  EXPECT_EQ(sink_.count, 2);
  EXPECT_EQ(sink_.heads, 1);
}

TEST_F(Osc, TheHalfOfALostPoseIsNotUsedInTheNextPose) {
  send(osc_message("/tracking/trackers/2/rotation", "", {0, 90, 0}));  // its position was lost
  arrival_ += 10 * kMillisecond;
  send(osc_message("/tracking/trackers/2/position", "", {0.5, 1, 2}));
  EXPECT_EQ(sink_.count, 0);
  send(osc_message("/tracking/trackers/2/rotation", "", {0, 0, 0}));
  ASSERT_EQ(sink_.count, 1);
  const JointSample& wrist = sink_.hands[1].joints[slot_of(Joint::wrist)];
  EXPECT_LT((to_quaternion(wrist.orientation) * Vector3(0, 0, -1) - Vector3(0, 0, -1)).norm(), 1e-6);
}

TEST_F(Osc, APlainHandIsAWristWithTheNewestCurls) {
  const Pose wrist{Vector3(0.1, 1.2, -0.3), Quaternion(Eigen::AngleAxisd(0.7, Vector3(1, 2, 3).normalized()))};
  const std::vector<double> curls{0, 1, 0.25, 0.5, 0.75};
  for (const Side side : {Side::left, Side::right}) {
    send(plain_hand(side, wrist, curls));
    const Skeleton& hand = sink_.hands[static_cast<std::size_t>(side)];
    Skeleton fingers;
    std::array<FingerCurl, kFingerCount> fingers_of_curls;
    for (std::size_t f = 0; f < kFingerCount; ++f)
      fingers_of_curls[f] = {.valid = true, .curl = {curls[f], curls[f], curls[f]}};
    CurlLifter(hand_, side).lift(fingers_of_curls, fingers);
    EXPECT_EQ(hand.hand.side, static_cast<std::uint32_t>(side));
    EXPECT_EQ(hand.frame, 0u);
    EXPECT_EQ(hand.joints[slot_of(Joint::wrist)].flags, kJointValid | kJointTracked);
    for (std::size_t j = 0; j < kJointCount; ++j) {
      EXPECT_LT((to_vector(hand.joints[j].position) - wrist * to_vector(fingers.joints[j].position)).norm(), 1e-5) << j;
      EXPECT_EQ(hand.joints[j].confidence, 1) << j;
    }
  }
  // Curls wait for the wrist, so that each wrist is one sample, also at the start and after a gap.
  EXPECT_EQ(sink_.count, 2);
  arrival_ += 150 * kMillisecond;
  send(plain_hand(Side::right, wrist, curls));
  EXPECT_EQ(sink_.count, 3);
  EXPECT_EQ(sink_.hands[1].frame, 0u);
  // Splays are part of the next hand.
  const auto index_tip = [&] { return to_vector(sink_.hands[1].joints[slot_of(Joint::index_tip)].position); };
  const Vector3 before = index_tip();
  send(osc_message("/hand/right/splays", "", {0, 0.2, 0, 0, 0}));
  EXPECT_EQ(sink_.count, 3);
  send(plain_hand(Side::right, wrist, curls));
  EXPECT_GT((index_tip() - before).norm(), 1e-3);
}

TEST_F(Osc, APlainHandMayLackItsWristOrItsFingers) {
  const auto flags = [&](Joint joint) { return sink_.hands[1].joints[slot_of(joint)].flags; };
  const std::vector<std::string> hand = plain_hand(Side::right, {Vector3(0.5, 1, 2), Quaternion::Identity()}, {5, 0});
  send(hand[1]);
  ASSERT_EQ(sink_.count, 1);
  EXPECT_EQ(flags(Joint::wrist), kJointValid | kJointTracked);
  EXPECT_EQ(flags(Joint::index_tip), 0u);
  // The wrist's sender has ended: fingers go on alone, as those of a glove.
  arrival_ += 200 * kMillisecond;
  const std::string curls = osc_message("/hand/right/curls", "", {0, 0, 0, 0, 0});
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(sink_.count, 1);
    arrival_ += 50 * kMillisecond;
    send(curls);
  }
  ASSERT_EQ(sink_.count, 2);
  EXPECT_EQ(sink_.hands[1].frame, 2u);
  EXPECT_EQ(flags(Joint::wrist), kJointValid | kJointInferred);
  EXPECT_EQ(flags(Joint::index_tip), kJointValid | kJointTracked);
  // And the wrist without the fingers, whose sender has ended. It is in the world again.
  arrival_ += 200 * kMillisecond;
  send(hand[1]);
  ASSERT_EQ(sink_.count, 3);
  EXPECT_EQ(sink_.hands[1].frame, 0u);
  EXPECT_EQ(flags(Joint::index_tip), 0u);

  const double nan = std::numeric_limits<double>::quiet_NaN();
  send(hand[0]);  // three curls are missing
  send(osc_message("/hand/right/curls", "", {0, 0, nan, 0, 0}));
  send(osc_message("/hand/right/splays", "", {0, 0, 0, 0, nan}));
  send(osc_message("/hand/right/wrist", "", {0, 0, 0, 0, 0, 0, 2}));
  EXPECT_EQ(refused("content"), 4);
  send(osc_message("/hand/middle/curls", "", {0, 0, 0, 0, 0}));
  send(osc_message("/hand/right/grip", "", {1}));
  EXPECT_EQ(decoder_.refusals().total(), 4u);
  EXPECT_EQ(sink_.count, 3);
}

TEST_F(Osc, RefusesBadNumbersAndIgnoresWhatItDoesNotKnow) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  send(osc_message("/VMC/Ext/Bone/Pos", "LeftHand", {0, 0, 0, 0, 0, 1}));  // a number is missing
  send(osc_message("/VMC/Ext/Bone/Pos", "LeftHand", {0, nan, 0, 0, 0, 0, 1}));
  send(osc_message("/VMC/Ext/Bone/Pos", "LeftHand", {0, 0, 0, 0, 0, 0, 2}));
  send(osc_message("/VMC/Ext/Hmd/Pos", "x", {2000, 0, 0, 0, 0, 0, 1}));
  send(osc_message("/tracking/trackers/1/position", "", {1, 2}));
  send(osc_message("/tracking/trackers/1/rotation", "", {nan, 0, 0}));
  EXPECT_EQ(refused("content"), 6);
  send(std::string("no osc"));
  EXPECT_EQ(refused("format"), 1);
  send(osc_message("/VMC/Ext/Blend/Val", "Joy", {1}));
  send(osc_message("/VMC/Ext/Bone/Pos", "LeftFoot", {0, 0, 0, 0, 0, 0, 1}));
  send(osc_message("/tracking/trackers/9/position", "", {0, 0, 0}));
  send(osc_message("/VMC/Ext/Root/Pos", "root", {0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 0, 0, 0}));  // surplus, as in VMC 2.1
  EXPECT_EQ(decoder_.refusals().total(), 7u);
  // All bones in one place.
  for (const std::string_view name : kHandNames)
    send(osc_message("/VMC/Ext/Bone/Pos", "Left" + std::string(name), {0, 0, 0, 0, 0, 0, 1}));
  EXPECT_EQ(refused("shape"), 1);
  EXPECT_EQ(sink_.count + sink_.heads, 0);
}

TEST_F(Osc, DoesNotAllocate) {
  const std::string packet = osc_bundle(frame());
  counting = true;
  for (int i = 0; i < 20; ++i) decoder_.take({packet, arrival_ += kMillisecond, 0, false}, sink_);
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_EQ(sink_.count, 40);
  const std::string plain = osc_bundle(plain_hand(Side::left, {}, {0, 1, 0, 1, 0}));
  counting = true;
  for (int i = 0; i < 20; ++i) decoder_.take({plain, arrival_ += kMillisecond, 0, false}, sink_);
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_EQ(sink_.count, 60);
}

}  // namespace
}  // namespace softhand::osc_test
