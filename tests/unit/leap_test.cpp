// Ultraleap: frames by WebSocket and by LeapC, both hands, recorded frames, and malformed messages.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include "messages/convert.hpp"
#include "support/captured_packets.hpp"
#include "support/count_allocations.hpp"
#include "support/counters.hpp"
#include "support/moving_hand.hpp"
#include "support/tracker_sink.hpp"
#include "trackers/leap/leap_hands.hpp"
#include "trackers/leap/leap_message.hpp"
#include "trackers/leap/leapc_service.hpp"
#include "trackers/leap/simulated_leap.hpp"

namespace softhand::leap_test {
namespace {

constexpr Nanoseconds kMillisecond = 1'000'000;

HandModel shipped_hand() { return load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json"); }

using Sink = testing::TrackerSamples;

class Leap : public ::testing::Test {
 protected:
  void take(const LeapFrame& frame) {
    arrival_ += 9 * kMillisecond;
    decoder_.take({frame.bytes(), arrival_, connection_, true}, sink_);
  }
  void send(const std::string& message) {
    LeapFrame frame;
    if (read_leap_message(message, frame)) take(frame);
  }
  // Time goes on with each frame.
  std::string message(LeapService service, const JointFrames& left, const JointFrames& right) {
    return leap_frame_message(microseconds_ += 9000, {{Side::left, left}, {Side::right, right}}, service);
  }
  double refused(const std::string& name) const {
    LoopStatus status;
    decoder_.refusals().fill_status(status, 0);
    return testing::counter_of(status, "refused_" + name);
  }
  // Sends the recorded frames of `name` and judges each hand in them.
  void judge_recorded_frames(const char* name) {
    if (!testing::has_captured(name)) GTEST_SKIP() << "no " << testing::captured_path(name);
    std::istringstream lines(testing::captured(name));
    int frames = 0, hands = 0;
    double worst = 0;
    for (std::string line; std::getline(lines, line); ++frames) {
      LeapFrame frame;
      ASSERT_TRUE(read_leap_message(line, frame));
      ASSERT_EQ(frame.refusal, LeapRefusal::none);
      take(frame);
      for (std::uint32_t i = 0; i < frame.hand_count; ++i) {
        const LeapHand& seen = frame.hands[i];
        const Skeleton& hand = sink_.hands[seen.side];
        EXPECT_GT(hand.confidence, 0);
        ++hands;
        // The index knuckle is where the service says, up to the proportions of the hand.
        worst = std::max(
            worst, (to_vector(hand.joints[slot_of(Joint::index_proximal)].position) - to_vector(seen.bones[1][1].from))
                       .norm());
        // The wrist is behind the palm, and the thumb on its side: on the left of a right hand from the back.
        const Pose wrist = to_pose(hand.joints[slot_of(Joint::wrist)]);
        EXPECT_GT((wrist.inverse() * to_vector(seen.palm)).z(), -0.12);
        EXPECT_LT((wrist.inverse() * to_vector(seen.palm)).z(), -0.03);
        const double thumb = (wrist.inverse() * to_vector(hand.joints[slot_of(Joint::thumb_proximal)].position)).x();
        EXPECT_LT(seen.side == 1 ? thumb : -thumb, 0);
      }
    }
    std::printf("%s: %d frames, %d hands, index knuckle within %.1f mm\n", name, frames, hands, 1e3 * worst);
    EXPECT_EQ(decoder_.refusals().total(), 0u);
    EXPECT_GE(hands, 240);
    EXPECT_LT(worst, 0.03);
  }
  // Sends the frames of `moving` as a right hand, and compares the hands that arrive.
  testing::Deviations follow(const testing::MovingHand& moving, LeapService service) {
    decoder_ = LeapDecoder(moving.hand, false);
    testing::Deviations deviations;
    for (const JointFrames& sent : moving.frames) {
      send(leap_frame_message(microseconds_ += 9000, {{Side::right, sent}}, service));
      for (std::size_t j = 0; j < kJointCount; ++j) deviations.add(j, to_pose(sink_.hands[1].joints[j]), sent[j]);
    }
    EXPECT_EQ(decoder_.refusals().total(), 0u);
    deviations.print(service == LeapService::beta ? "without bones" : "with bones");
    return deviations;
  }

  HandModel hand_ = shipped_hand();
  LeapDecoder decoder_{hand_, false};
  Sink sink_;
  std::uint64_t connection_ = 1;
  std::int64_t microseconds_ = 0;
  Nanoseconds arrival_ = 1'000'000 * kMillisecond;
};

TEST_F(Leap, FramesWithBonesAreExactOnBothHandsOfBothServices) {
  const JointFrames left = above_camera(mirrored(hand_).rest_joints, -0.1),
                    right = above_camera(hand_.rest_joints, 0.1);
  for (const LeapService service : {LeapService::old, LeapService::current}) {
    sink_ = {};
    send(message(service, left, right));
    ASSERT_EQ(sink_.count, 2);
    for (std::size_t side = 0; side < 2; ++side) {
      const JointFrames& real = side == 0 ? left : right;
      EXPECT_EQ(sink_.hands[side].frame, 2u);
      EXPECT_EQ(sink_.hands[side].confidence, 1);
      for (std::size_t j = 1; j < kJointCount; ++j) {
        const JointSample& joint = sink_.hands[side].joints[j];
        EXPECT_EQ(joint.flags, kJointValid | kJointTracked);
        EXPECT_LT((to_vector(joint.position) - real[j].position).norm(), 1e-6) << side << kJointNames[j];
        // The hand's joints may point past the next joint by some degrees. The bones of the camera do not.
        EXPECT_LT(to_quaternion(joint.orientation).angularDistance(real[j].orientation), 0.1) << side << kJointNames[j];
      }
      EXPECT_EQ(sink_.hands[side].joints[slot_of(Joint::palm)].flags, kJointValid | kJointInferred);
      EXPECT_LT((to_vector(sink_.hands[side].joints[slot_of(Joint::palm)].position) - real[0].position).norm(), 0.03);
    }
  }
  EXPECT_EQ(decoder_.refusals().total(), 0u);
}

TEST_F(Leap, FramesWithoutBonesAreFittedToTheHand) {
  const JointFrames left = above_camera(mirrored(hand_).rest_joints, -0.1),
                    right = above_camera(hand_.rest_joints, 0.1);
  send(message(LeapService::beta, left, right));
  ASSERT_EQ(sink_.count, 2);
  for (std::size_t side = 0; side < 2; ++side) {
    const JointFrames& real = side == 0 ? left : right;
    for (std::size_t j = 1; j < kJointCount; ++j) {
      const JointSample& joint = sink_.hands[side].joints[j];
      EXPECT_LT((to_vector(joint.position) - real[j].position).norm(), 0.004) << side << kJointNames[j];
      EXPECT_LT(to_quaternion(joint.orientation).angularDistance(real[j].orientation), 12 * M_PI / 180)
          << side << kJointNames[j];
    }
    EXPECT_EQ(sink_.hands[side].joints[slot_of(Joint::wrist)].flags, kJointValid | kJointInferred);
    EXPECT_EQ(sink_.hands[side].joints[slot_of(Joint::index_tip)].flags, kJointValid | kJointTracked);
  }
}

TEST_F(Leap, AHandThatIsNotSeenHasNoConfidence) {
  send(R"({"currentFrameRate":110,"id":7,"timestamp":1234567,"devices":[],"hands":[],"pointables":[]})");
  EXPECT_EQ(sink_.count, 2);
  EXPECT_EQ(sink_.hands[0].confidence + sink_.hands[1].confidence, 0);
  microseconds_ = 2'000'000;
  send(leap_frame_message(microseconds_, {{Side::left, mirrored(hand_).rest_joints}}, LeapService::current));
  EXPECT_EQ(sink_.hands[0].confidence, 1);
  EXPECT_EQ(sink_.hands[1].confidence, 0);
  EXPECT_EQ(sink_.hands[1].stamp.sequence, 2u);
  // Greeting and events are no frames.
  const int before = sink_.count;
  send(kLeapServiceGreeting);
  send(R"({"serviceVersion":"2.3.1+33747", "version":6})");
  send(R"({"event":{"type":"deviceEvent","state":{"attached":true,"id":"1","streaming":true,"type":"peripheral"}}})");
  EXPECT_EQ(sink_.count, before);
  EXPECT_EQ(decoder_.refusals().total(), 0u);
}

TEST_F(Leap, OfTwoHandsOfOneSideTheSurerOneIsUsed) {
  LeapFrame frame;
  LeapHand hand;
  hand.confidence = 0.5;
  add_hand(frame, hand);
  hand.confidence = 0.8;
  add_hand(frame, hand);
  hand.confidence = 0.2;
  add_hand(frame, hand);
  ASSERT_EQ(frame.hand_count, 1u);
  EXPECT_EQ(frame.hands[0].confidence, 0.8);
}

TEST_F(Leap, TimesAreThoseOfTheService) {
  const auto frame = [&](std::int64_t microseconds) {
    return leap_frame_message(microseconds, {}, LeapService::current);
  };
  send(frame(1'000'000));
  EXPECT_EQ(sink_.hands[0].stamp.sample_time, arrival_);
  send(frame(1'003'000));  // 9 ms later
  EXPECT_EQ(sink_.hands[0].stamp.sample_time, arrival_ - 6 * kMillisecond);
  send(frame(1'003'000));
  EXPECT_EQ(refused("order"), 1);
  ++connection_;
  send(frame(5));  // another service
  EXPECT_EQ(sink_.hands[0].stamp.sample_time, arrival_);
  EXPECT_EQ(refused("order"), 1);
}

TEST_F(Leap, RecordedFramesOfOneHandAreHands) { judge_recorded_frames("leap/pinch-right.jsonl"); }
TEST_F(Leap, RecordedFramesOfBothHandsAreHands) { judge_recorded_frames("leap/claps-both.jsonl"); }

TEST_F(Leap, FollowsAGeneratedHand) {
  const testing::MovingHand moving = testing::generated_hand(hand_);
  EXPECT_LT(follow(moving, LeapService::current).distance(1), 0.01);
  EXPECT_LT(follow(moving, LeapService::beta).distance(1), 0.01);
}

TEST_F(Leap, FollowsARecordedHand) {
  if (!std::filesystem::exists(testing::recorded_hand_path())) GTEST_SKIP() << "no " << testing::recorded_hand_path();
  const testing::MovingHand moving = testing::recorded_hand(hand_);
  testing::Deviations with_bones = follow(moving, LeapService::current);
  EXPECT_LT(with_bones.distance(0.5), 5);
  EXPECT_LT(with_bones.distance(0.99), 0.01);
  testing::Deviations without_bones = follow(moving, LeapService::beta);
  EXPECT_LT(without_bones.distance(0.5), 5);
  EXPECT_LT(without_bones.distance(0.99), 25);
}

TEST_F(Leap, RefusesBadMessages) {
  const std::string good = message(LeapService::current, hand_.rest_joints, hand_.rest_joints);
  send(good.substr(0, good.size() - 1));  // truncated
  send(good + good);                      // joined
  send(good.substr(100));                 // split
  send("");
  send("[1]");
  EXPECT_EQ(refused("json"), 5);
  using Json = nlohmann::json;
  const auto spoilt = [&](const char* pointer, const Json& value) {
    Json json = Json::parse(good);
    json[Json::json_pointer(pointer)] = value;
    send(json.dump());
  };
  send("{}");
  send(R"({"hands":[],"pointables":[]})");
  send(R"({"hands":[],"timestamp":5})");
  spoilt("/timestamp", -1);
  spoilt("/timestamp", 1.5);
  spoilt("/hands", 3);
  spoilt("/hands/0", 3);
  spoilt("/hands/0/type", "middle");
  spoilt("/hands/0/confidence", 2);
  spoilt("/hands/0/direction", Json{0, 0, 2});
  spoilt("/hands/0/palmPosition", Json{0, 0, nullptr});
  spoilt("/hands/0/palmPosition", Json{0, 0});
  spoilt("/hands/0/wrist", Json{0, 0, 1e6});
  spoilt("/pointables/0", nullptr);
  spoilt("/pointables/0/type", 5);
  spoilt("/pointables/0/type", 1);     // the index finger twice, and no thumb
  spoilt("/pointables/0/handId", 17);  // a hand without a thumb
  spoilt("/pointables/0/mcpPosition", "x");
  spoilt("/pointables/0/bases", Json{1});
  spoilt("/pointables/0/bases/0/1", Json{0, 0, 0});
  EXPECT_EQ(refused("content"), 20);
  spoilt("/pointables/1/dipPosition", Json::parse(good)["pointables"][1]["pipPosition"]);  // a bone without length
  EXPECT_EQ(refused("shape"), 1);
  EXPECT_EQ(sink_.count, 1);  // the other hand of that frame
  EXPECT_EQ(decoder_.refusals().total(), 26u);
}

TEST_F(Leap, EventsOfLeapCAreHands) {
  const JointFrames left = above_camera(mirrored(hand_).rest_joints, -0.1),
                    right = above_camera(hand_.rest_joints, 0.1);
  const std::array<leapc::Hand, 2> hands{leapc_hand({Side::left, left}), leapc_hand({Side::right, right})};
  leapc::TrackingEvent event{nullptr, 1, 5000, 1, 2, hands.data(), 90};
  // LeapC's clock is 1 s behind ours, and the frame is 4 ms old at its arrival.
  take(read_leapc(event, arrival_ + 9 * kMillisecond - 4 * kMillisecond - 5 * kMillisecond));
  ASSERT_EQ(sink_.count, 2);
  for (std::size_t side = 0; side < 2; ++side) {
    EXPECT_EQ(sink_.hands[side].stamp.sample_time, arrival_ - 4 * kMillisecond);
    for (std::size_t j = 1; j < kJointCount; ++j) {
      const JointSample& joint = sink_.hands[side].joints[j];
      const Pose& real = side == 0 ? left[j] : right[j];
      EXPECT_LT((to_vector(joint.position) - real.position).norm(), 1e-6) << side << kJointNames[j];
      EXPECT_LT(to_quaternion(joint.orientation).angularDistance(real.orientation), 0.1) << side << kJointNames[j];
      EXPECT_NEAR(joint.radius, j == 1 ? 0 : 0.008, 1e-9);
    }
  }
  event.hand_count = 0;
  event.timestamp = 3'600'000'000;  // an hour ahead
  take(read_leapc(event, arrival_));
  EXPECT_EQ(refused("content"), 1);
  event.timestamp = 9000;
  take(read_leapc(event, arrival_));
  EXPECT_EQ(sink_.hands[0].confidence, 0);
  EXPECT_EQ(decoder_.refusals().total(), 1u);
  std::array<leapc::Hand, 2> bad = hands;
  bad[1].palm.position[0] = std::numeric_limits<float>::quiet_NaN();
  event = {nullptr, 1, 20000, 1, 2, bad.data(), 90};
  EXPECT_EQ(read_leapc(event, 0).refusal, LeapRefusal::content);
  bad = hands;
  bad[0].digits[2].bones[1].rotation[3] = 7;
  EXPECT_EQ(read_leapc(event, 0).refusal, LeapRefusal::content);
  event.hands = nullptr;
  EXPECT_EQ(read_leapc(event, 0).refusal, LeapRefusal::content);
  event = {nullptr, 1, -1, 1, 2, hands.data(), 90};
  EXPECT_EQ(read_leapc(event, 0).refusal, LeapRefusal::content);
}

TEST_F(Leap, DoesNotAllocate) {
  LeapFrame full, beta;
  read_leap_message(message(LeapService::current, hand_.rest_joints, hand_.rest_joints), full);
  read_leap_message(message(LeapService::beta, hand_.rest_joints, hand_.rest_joints), beta);
  counting = true;
  for (int i = 0; i < 50; ++i) {
    for (LeapFrame* frame : {&full, &beta}) {
      frame->time += 20 * kMillisecond;
      take(*frame);
    }
  }
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_GT(sink_.count, 0);
}

}  // namespace
}  // namespace softhand::leap_test
