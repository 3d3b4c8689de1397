// Frames of a headset's page, the mapping of senders' clocks, and the lifting of 21 landmarks to a hand.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "messages/convert.hpp"
#include "support/moving_hand.hpp"
#include "support/webxr_frame.hpp"
#include "trackers/landmarks/landmarks.hpp"
#include "trackers/replay/generator.hpp"
#include "trackers/webxr/webxr_frames.hpp"

namespace softhand {
namespace {

constexpr Nanoseconds kMillisecond = 1'000'000;
using testing::webxr_frame;
using testing::WebXrPlace;

std::string with_float(std::string frame, std::size_t offset, float value) {
  std::memcpy(frame.data() + offset, &value, sizeof value);
  return frame;
}

TEST(WebXrFrames, RoundTrip) {
  WebXrSample sample;
  ASSERT_EQ(decode_webxr(webxr_frame(1000, 1005), sample), WebXrRefusal::none);
  EXPECT_EQ(sample.sample_time, 1000 * kMillisecond);
  EXPECT_EQ(sample.sent, 1005 * kMillisecond);
  EXPECT_EQ(sample.head.valid, 1u);
  EXPECT_NEAR(sample.head.position[1], 1.6, 1e-6);
  for (std::uint32_t side = 0; side < 2; ++side) {
    const Skeleton& hand = sample.hands[side];
    EXPECT_EQ(hand.hand.side, side);
    EXPECT_EQ(hand.confidence, 1);
    EXPECT_EQ(hand.joints[0].flags, kJointValid | kJointInferred);
    for (std::size_t j = 1; j < kJointCount; ++j) {
      EXPECT_EQ(hand.joints[j].flags, kJointValid | kJointTracked);
      EXPECT_NEAR(hand.joints[j].position[2], -0.01 * static_cast<double>(j), 1e-6);
      EXPECT_NEAR(hand.joints[j].position[0], side == 0 ? -0.2 : 0.2, 1e-6);
      EXPECT_NEAR(to_quaternion(hand.joints[j].orientation).norm(), 1, 1e-12);
    }
    // Halfway between middle metacarpal (11) and proximal (12).
    EXPECT_NEAR(hand.joints[0].position[2], -0.115, 1e-6);
  }
}

TEST(WebXrFrames, RefusesBadFramesAndLeavesTheSampleUnchanged) {
  const std::string good = webxr_frame(1000, 1000);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto joint = [](std::size_t field) { return WebXrPlace::right_joints + 32 * 7 + 4 * field; };
  std::string version = good, magic = good, mask = good;
  version[4] = 2;
  magic[0] = 'X';
  mask[WebXrPlace::right_mask + 3] = 2;
  const std::pair<std::string, WebXrRefusal> cases[]{
      {"", WebXrRefusal::size},
      {good.substr(1), WebXrRefusal::size},
      {good + "x", WebXrRefusal::size},
      {magic, WebXrRefusal::magic},
      {version, WebXrRefusal::version},
      {mask, WebXrRefusal::content},
      {with_float(good, joint(0), nan), WebXrRefusal::content},
      {with_float(good, joint(1), 1001), WebXrRefusal::content},
      {with_float(good, joint(6), 2), WebXrRefusal::content},
      {with_float(good, joint(7), -0.01f), WebXrRefusal::content},
      {with_float(good, joint(7), 0.2f), WebXrRefusal::content},
      {with_float(good, WebXrPlace::head + 4, nan), WebXrRefusal::content},
      {webxr_frame(std::nan(""), 1000), WebXrRefusal::content},
      {webxr_frame(1000, std::numeric_limits<double>::infinity()), WebXrRefusal::content},
      {webxr_frame(1000, 5000), WebXrRefusal::content},
      {webxr_frame(5000, 1000), WebXrRefusal::content},
  };
  for (std::size_t i = 0; i < std::size(cases); ++i) {
    WebXrSample sample;
    sample.sample_time = 7;
    EXPECT_EQ(decode_webxr(cases[i].first, sample), cases[i].second) << "case " << i;
    EXPECT_EQ(sample.sample_time, 7) << "case " << i;
  }
}

TEST(WebXrFrames, IgnoresValuesOfJointsThatAreNotSeen) {
  std::string frame = webxr_frame(1000, 1000, 0, 0x1ffffff & ~(1u << 10));  // no right middle metacarpal
  frame = with_float(frame, WebXrPlace::right_joints + 32 * 10, std::numeric_limits<float>::quiet_NaN());
  WebXrSample sample;
  ASSERT_EQ(decode_webxr(frame, sample), WebXrRefusal::none);
  EXPECT_EQ(sample.hands[0].confidence, 0);
  EXPECT_NEAR(sample.hands[1].confidence, 24.0 / 25, 1e-12);
  EXPECT_EQ(sample.hands[1].joints[11].flags, 0u);
  EXPECT_EQ(sample.hands[1].joints[0].flags, 0u);  // no palm without the middle metacarpal
}

TEST(ClockMapping, LeastDelayedMessageGivesTheOffset) {
  ClockMapping clock;
  constexpr Nanoseconds kOffset = 123'456 * kMillisecond;
  for (int i = 0; i < 3000; ++i) {  // 33 s, delays 2 to 20 ms
    const Nanoseconds sent = i * 11 * kMillisecond;
    clock.add(sent, sent + kOffset + (2 + (i * 7) % 19) * kMillisecond);
    if (i > 20) {
      EXPECT_EQ(clock.map(sent), sent + kOffset + 2 * kMillisecond) << i;
    }
  }
}

TEST(ClockMapping, FollowsDriftAndARestartedClock) {
  ClockMapping clock;
  double worst = 0;
  for (int i = 0; i < 10'000; ++i) {  // 100 s. The sender's clock runs 100 ppm slow, so differences grow
    const Nanoseconds sent = i * 10 * kMillisecond;
    const Nanoseconds arrival = sent + sent / 10'000;
    clock.add(sent, arrival);
    worst = std::max(worst, std::abs(static_cast<double>(clock.map(sent) - arrival)) * 1e-6);
  }
  EXPECT_LE(worst, 2.1);  // ms: 100 ppm of two windows
  clock.add(5 * kMillisecond, 200'000 * kMillisecond);
  EXPECT_EQ(clock.map(5 * kMillisecond), 200'000 * kMillisecond);
}

TEST(ClockMapping, ForgetsOldMessages) {
  ClockMapping clock;
  clock.add(10 * kMillisecond, 20 * kMillisecond);
  // An hour passes without a message. The sender's clock runs 50 ppm slow.
  const Nanoseconds sent = 3'600'000 * kMillisecond;
  const Nanoseconds arrival = sent + 190 * kMillisecond;
  clock.add(sent, arrival);
  EXPECT_EQ(clock.map(sent), arrival);
}

TEST(WebXrClock, StampsAscendAndAreNeverInTheFuture) {
  WebXrClock clock;
  WebXrSample sample;
  Nanoseconds last = 0;
  for (int i = 1; i < 200; ++i) {
    const double time = 11.0 * i;
    ASSERT_EQ(decode_webxr(webxr_frame(time + 20, time), sample), WebXrRefusal::none);  // predicted 20 ms ahead
    const Nanoseconds arrival = (5000 + 11 * i + i % 5) * kMillisecond;
    ASSERT_EQ(clock.stamp(sample, 1, arrival), WebXrRefusal::none);
    const Nanoseconds stamped = sample.hands[1].stamp.sample_time;
    EXPECT_GT(stamped, last);
    EXPECT_LE(stamped, arrival);
    EXPECT_EQ(sample.head.stamp.sample_time, stamped);
    last = stamped;
  }
  EXPECT_EQ(clock.stamp(sample, 1, 9000 * kMillisecond), WebXrRefusal::order);  // the same sample again
  EXPECT_EQ(clock.stamp(sample, 2, 9000 * kMillisecond), WebXrRefusal::none);   // another page
}

TEST(LandmarksClock, StampsAscendAndOldPicturesAreRefused) {
  LandmarksClock clock;
  const auto take = [&clock](double taken, double sent, double arrival, Side side = Side::right) {
    LandmarksMessage message;
    message.side = side;
    message.sample_time = taken;
    message.sent_time = sent;
    return clock.stamp(message, 0, static_cast<Nanoseconds>((5000 + arrival) * 1e6));
  };
  // The first message took 250 ms, and the later ones waited behind it. The second picture took longer to process.
  const auto first = take(1000, 1010, 1260);
  ASSERT_TRUE(first);
  auto last = *first;
  for (const auto& [taken, sent, arrival] : {std::array{1033.0, 1073.0, 1261.0},
                                             {1066.0, 1076.0, 1262.0},
                                             {1100.0, 1110.0, 1263.0},
                                             {1253.0, 1263.0, 1264.0}}) {
    const auto time = take(taken, sent, arrival);
    ASSERT_TRUE(time) << taken;
    EXPECT_GT(*time, last) << taken;
    EXPECT_LE(*time, static_cast<Nanoseconds>((5000 + arrival) * 1e6)) << taken;
    last = *time;
  }
  EXPECT_FALSE(take(1253, 1270, 1271)) << "the same picture";
  EXPECT_FALSE(take(1100, 1272, 1273)) << "an older picture";
  EXPECT_TRUE(take(1253, 1280, 1281, Side::left)) << "a picture of the other hand";
  EXPECT_TRUE(take(10, 20, 9000)) << "the sender restarted";
}

Landmarks landmarks_of(const JointFrames& frames) {
  Landmarks points;
  for (std::size_t i = 0; i < kLandmarkCount; ++i) points[i] = frames[slot_of(joint_of_landmark(i))].position;
  return points;
}

HandModel shipped_hand() { return load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json"); }

struct Errors {
  double position = 0;     // m
  double orientation = 0;  // rad
  Joint worst = Joint::palm;
};
void add_errors(Errors& errors, const JointFrames& lifted, const JointFrames& real) {
  for (std::size_t j = 0; j < kJointCount; ++j) {
    errors.position = std::max(errors.position, (lifted[j].position - real[j].position).norm());
    const double turn = lifted[j].orientation.angularDistance(real[j].orientation);
    if (turn > errors.orientation) errors.worst = static_cast<Joint>(j);
    errors.orientation = std::max(errors.orientation, turn);
  }
}

TEST(Landmarks, LiftingRecoversGeneratedMotions) {
  for (const bool left : {false, true}) {
    const HandModel hand = left ? mirrored(shipped_hand()) : shipped_hand();
    const LandmarkLifter lifter(hand, hand.side);
    for (const char* name : {"fist", "free_motion"}) {
      GeneratorOptions options;
      options.motion = name;
      const auto motion = make_motion(hand, options);
      Errors errors;
      for (double time = 0; time < motion->duration(); time += 0.05) {
        const JointFrames real = motion->at(time);
        const auto lifted = lifter.lift(landmarks_of(real));
        ASSERT_TRUE(lifted);
        add_errors(errors, *lifted, real);
      }
      std::printf("%s %s: %.2f mm, %.2f degrees (%s)\n", left ? "left" : "right", name, 1e3 * errors.position,
                  errors.orientation * 180 / M_PI, kJointNames[slot_of(errors.worst)].data());
      EXPECT_LT(errors.position, 0.003);
      EXPECT_LT(errors.orientation, 6 * M_PI / 180);
    }
  }
}

// A real hand bends and twists in ways that the hand file's joints cannot. So this test measures the accuracy of
// landmarks. The palm (joint 0) is left out because recordings infer it.
TEST(Landmarks, LiftingRecoversARecordedHand) {
  if (!std::filesystem::exists(testing::recorded_hand_path())) GTEST_SKIP() << "no " << testing::recorded_hand_path();
  const testing::MovingHand moving = testing::recorded_hand(shipped_hand());
  const LandmarkLifter lifter(moving.hand, moving.hand.side);
  testing::Deviations deviations;
  for (const JointFrames& real : moving.frames) {
    const auto lifted = lifter.lift(landmarks_of(real));
    ASSERT_TRUE(lifted);
    for (std::size_t j = 0; j < kJointCount; ++j) deviations.add(j, (*lifted)[j], real[j]);
  }
  ASSERT_EQ(deviations.count(), 756u * 25);
  deviations.print("recorded");
  // Measured (median, 99 %, worst): 0.53, 8.8 and 15.4 mm, and 1.8, 8.2 and 14.7 degrees.
  EXPECT_LT(deviations.distance(0.5), 0.8);
  EXPECT_LT(deviations.distance(0.99), 11);
  EXPECT_LT(deviations.distance(1), 19);
  EXPECT_LT(deviations.turn(0.5), 2.4);
  EXPECT_LT(deviations.turn(0.99), 10);
  EXPECT_LT(deviations.turn(1), 18);
}

TEST(Landmarks, KeepsTheHandsBoneLengthsForAnyLandmarks) {
  const HandModel hand = shipped_hand();
  Landmarks points = landmarks_of(hand.rest_joints);
  for (std::size_t i = 0; i < kLandmarkCount; ++i)
    points[i] = 1.3 * points[i] +
                0.004 * Vector3(std::sin(7.0 * static_cast<double>(i)), std::cos(5.0 * static_cast<double>(i)), 0);
  const auto lifted = LandmarkLifter(hand, hand.side).lift(points);
  ASSERT_TRUE(lifted);
  for (std::size_t j = slot_of(Joint::thumb_metacarpal); j + 1 < kJointCount; ++j) {
    if (j == 5 || (j >= 6 && (j - 6) % 5 == 4)) continue;  // from a tip to the next finger
    EXPECT_NEAR(((*lifted)[j + 1].position - (*lifted)[j].position).norm(),
                (hand.rest_joints[j + 1].position - hand.rest_joints[j].position).norm(), 1e-12);
    EXPECT_NEAR((*lifted)[j].orientation.norm(), 1, 1e-12);
  }
}

TEST(Landmarks, DegenerateLandmarksAreRefused) {
  const LandmarkLifter lifter(shipped_hand(), Side::right);
  Landmarks point;
  point.fill(Vector3::Zero());
  EXPECT_FALSE(lifter.lift(point));
  Landmarks line;
  for (std::size_t i = 0; i < kLandmarkCount; ++i) line[i] = Vector3(0.01 * static_cast<double>(i), 0, 0);
  EXPECT_FALSE(lifter.lift(line));
  LandmarksMessage message;
  message.coordinates = Coordinates::image;
  EXPECT_FALSE(place_landmarks(message, {}, lifter.palm_size()));
}

TEST(Landmarks, TheCameraPlacesBothKindsOfCoordinates) {
  const HandModel hand = shipped_hand();
  const LandmarkLifter lifter(hand, hand.side);
  LandmarksOptions options;  // the camera looks along +Z from (0, 0.15, -0.5)
  // The rest hand (its palm level), 0.5 m in front of the camera, in weak perspective.
  const Landmarks rest = landmarks_of(hand.rest_joints);
  const double half_width = 0.5 * std::tan(0.5 * options.field_of_view);  // m, half the picture's width at that depth
  LandmarksMessage world, image;
  image.coordinates = Coordinates::image;
  image.aspect = 4.0 / 3;
  for (std::size_t i = 0; i < kLandmarkCount; ++i) {
    // Camera axes: right is the world's -X, down is -Y, forward is +Z.
    world.landmarks[i] = {-rest[i].x(), -rest[i].y(), rest[i].z()};
    const Vector3 share = to_vector(world.landmarks[i]) / (2 * half_width);
    image.landmarks[i] = {0.5 + share.x(), 0.5 + image.aspect * share.y(), share.z()};
  }
  for (const LandmarksMessage& message : {world, image}) {
    const auto placed = place_landmarks(message, options, lifter.palm_size());
    ASSERT_TRUE(placed);
    for (std::size_t i = 0; i < kLandmarkCount; ++i)
      EXPECT_LT(((*placed)[i] - (rest[i] + Vector3(0, 0.15, 0))).norm(), 1e-9) << i << " " << (*placed)[i].transpose();
  }
}

std::string json(const std::string& changes = "", std::size_t count = kLandmarkCount,
                 const std::string& point = "[0.1,0.2,0.3]") {
  std::string text = R"({"version":1,"hand":"left","coordinates":"world")" + changes + R"(,"landmarks":[)";
  for (std::size_t i = 0; i < count; ++i) text += (i > 0 ? "," : "") + point;
  return text + "]}";
}

TEST(Landmarks, AreDecodedInTheThreadThatReceivesThem) {
  const Translate translate = translate_landmarks();
  for (const auto& [text, refusal] :
       {std::pair{std::string("no json"), LandmarksRefusal::json}, std::pair{json(), LandmarksRefusal::none}}) {
    const std::string_view bytes = translate({text, 0, 0, false});
    const auto decoded = value_in<DecodedLandmarks>({bytes, 0, 0, false});
    EXPECT_EQ(decoded.refusal, refusal);
    EXPECT_EQ(decoded.message.landmarks[20], refusal == LandmarksRefusal::none ? (Vec3{0.1, 0.2, 0.3}) : Vec3{});
  }
}

TEST(Landmarks, RefusesBadMessages) {
  LandmarksMessage message;
  ASSERT_EQ(decode_landmarks(json(R"(,"score":0.9,"sample_time_ms":10,"sent_time_ms":30)"), message),
            LandmarksRefusal::none);
  EXPECT_EQ(message.side, Side::left);
  EXPECT_EQ(message.score, 0.9);
  EXPECT_EQ(message.sample_time, 10.0);
  EXPECT_EQ(message.landmarks[20], (Vec3{0.1, 0.2, 0.3}));
  const std::pair<std::string, LandmarksRefusal> cases[]{
      {"", LandmarksRefusal::json},
      {"[1,2]", LandmarksRefusal::json},
      {json().substr(0, 60), LandmarksRefusal::json},
      {std::string(8000, '['), LandmarksRefusal::json},
      {json("", 21, "[NaN,0,0]"), LandmarksRefusal::json},
      {R"({"hand":"left"})", LandmarksRefusal::version},
      {R"({"version":2})", LandmarksRefusal::version},
      {R"({"version":1,"hand":"both"})", LandmarksRefusal::content},
      {json("", 20), LandmarksRefusal::content},
      {json("", 22), LandmarksRefusal::content},
      {json("", 21, "[0,0]"), LandmarksRefusal::content},
      {json("", 21, "[0,0,null]"), LandmarksRefusal::content},
      {json("", 21, "[0,0,1e9]"), LandmarksRefusal::content},
      {json(R"(,"score":2)"), LandmarksRefusal::content},
      {json(R"(,"score":"high")"), LandmarksRefusal::content},
      {json(R"(,"sample_time_ms":10)"), LandmarksRefusal::content},
      {json(R"(,"sample_time_ms":10,"sent_time_ms":9)"), LandmarksRefusal::content},
      {json(R"(,"sample_time_ms":9.9e12,"sent_time_ms":9.9e12)"),
       LandmarksRefusal::content},  // more nanoseconds than a stamp holds
      {R"({"version":1,"hand":"left","coordinates":"image","landmarks":[]})", LandmarksRefusal::content},  // no aspect
  };
  for (std::size_t i = 0; i < std::size(cases); ++i)
    EXPECT_EQ(decode_landmarks(cases[i].first, message), cases[i].second) << "case " << i;
}

}  // namespace
}  // namespace softhand
