// Hand Tracking Streamer: the app's lines, from the documented datagram, from a recorded hand, and damaged.
#include "trackers/streamer/streamer.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "messages/convert.hpp"
#include "support/count_allocations.hpp"
#include "support/counters.hpp"
#include "support/moving_hand.hpp"
#include "trackers/streamer/simulated_streamer.hpp"

namespace softhand::streamer_test {
namespace {

using testing::Deviations;

constexpr Nanoseconds kMillisecond = 1'000'000;

// The right hand of the app's documentation (CONNECTIONS.md), with its little finger from the metacarpal.
const std::string kDocumented =
    "Right wrist:, 0.2502, 1.0635, 0.2540, 0.194, -0.116, 0.094, -0.970\n"
    "Right landmarks:, 0.0000, 0.0000, 0.0000, -0.0275, -0.0197, 0.0362, -0.0438, -0.0335, 0.0608, -0.0418, -0.0480, "
    "0.0913, -0.0329, -0.0595, 0.1111, -0.0236, -0.0073, 0.0960, -0.0179, -0.0226, 0.1302, -0.0150, -0.0428, 0.1435, "
    "-0.0116, -0.0633, 0.1518, -0.0017, -0.0025, 0.0956, 0.0054, -0.0226, 0.1329, 0.0081, -0.0456, 0.1478, 0.0100, "
    "-0.0680, 0.1589, 0.0175, -0.0065, 0.0887, 0.0252, -0.0222, 0.1236, 0.0279, -0.0407, 0.1424, 0.0282, -0.0595, "
    "0.1580, 0.0230, -0.0094, 0.0341, 0.0351, -0.0137, 0.0779, 0.0433, -0.0227, 0.1061, 0.0477, -0.0342, 0.1223";

HandModel shipped_hand() { return load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json"); }

struct Sink final : TrackerSink {
  void hand(const Skeleton& sample) override {
    newest = sample;
    ++hands;
  }
  void head(const HeadPose& sample) override {
    newest_head = sample;
    ++heads;
  }
  Skeleton newest;
  HeadPose newest_head;
  int hands = 0, heads = 0;
};

class Streamer : public ::testing::Test {
 protected:
  // A datagram if `connection` is 0, else the lines of a stream.
  void send(const std::string& text, std::uint64_t connection = 0) {
    arrival_ += 14 * kMillisecond;
    if (connection == 0) return decoder_.take({text, arrival_, 0, false}, sink_);
    for (std::size_t begin = 0; begin < text.size();) {
      const std::size_t end = std::min(text.find('\n', begin), text.size());
      decoder_.take({std::string_view(text).substr(begin, end - begin), arrival_, connection, false}, sink_);
      begin = end + 1;
    }
  }
  Deviations follow(const testing::MovingHand& moving);
  double refused(const std::string& name) const {
    LoopStatus status;
    decoder_.refusals().fill_status(status, 0);
    return testing::counter_of(status, "refused_" + name);
  }
  Vector3 place(Joint joint) const { return to_vector(sink_.newest.joints[slot_of(joint)].position); }

  HandModel hand_ = shipped_hand();
  StreamerDecoder decoder_{hand_};
  Sink sink_;
  Nanoseconds arrival_ = 1'000'000 * kMillisecond;
};

TEST_F(Streamer, TheDocumentedDatagramIsAHand) {
  const std::string captured = std::string(SOFTHAND_SOURCE_DIR) + "/../shared/data/hts/udp-datagram.txt";
  if (std::filesystem::exists(captured)) {
    std::ifstream in(captured, std::ios::binary);
    EXPECT_EQ(std::string(std::istreambuf_iterator<char>(in), {}), kDocumented);
  }
  send(kDocumented);
  ASSERT_EQ(sink_.hands, 1);
  EXPECT_EQ(decoder_.refusals().total(), 0u);
  const Skeleton& hand = sink_.newest;
  EXPECT_EQ(hand.hand.side, 1u);
  EXPECT_EQ(hand.confidence, 1);
  EXPECT_LT((place(Joint::wrist) - Vector3(0.2502, 1.0635, -0.2540)).norm(), 1e-9);
  // The wrist's measured orientation: the palm of the lifted hand is within 15 degrees of it, for a model with other
  // proportions. An error in handedness would turn it by far more.
  const Quaternion measured = Quaternion(-0.970, -0.194, 0.116, 0.094).normalized();
  EXPECT_LT(to_quaternion(hand.joints[slot_of(Joint::wrist)].orientation).angularDistance(measured), 15 * M_PI / 180);
  // A right hand: seen from the back with the fingers forward, the thumb is on the left.
  EXPECT_LT((measured.inverse() * (place(Joint::thumb_tip) - place(Joint::little_tip))).x(), 0);
  for (std::size_t j = 0; j < kJointCount; ++j) EXPECT_NE(hand.joints[j].flags & kJointValid, 0u) << j;
  // The tip of the little finger is not among the 21 points.
  EXPECT_EQ(hand.joints[slot_of(Joint::little_tip)].flags, kJointValid | kJointInferred);
  EXPECT_EQ(hand.joints[slot_of(Joint::ring_tip)].flags, kJointValid | kJointTracked);
  EXPECT_EQ(hand.joints[slot_of(Joint::little_distal)].confidence, kGuessedConfidence);
  EXPECT_EQ(hand.joints[slot_of(Joint::ring_distal)].confidence, 1);
}

TEST_F(Streamer, OnlyALittleFingerFromItsMetacarpalIsMended) {
  Landmarks rest;
  for (std::size_t i = 0; i < kLandmarkCount; ++i) rest[i] = hand_.rest_joints[slot_of(joint_of_landmark(i))].position;
  Landmarks shifted = rest;
  EXPECT_FALSE(mend_little_finger(shifted));
  EXPECT_EQ(shifted, rest);
  for (int i = 0; i < 4; ++i) shifted[17 + i] = hand_.rest_joints[slot_of(Joint::little_metacarpal) + i].position;
  EXPECT_TRUE(mend_little_finger(shifted));
  for (std::size_t i = 17; i < 20; ++i) EXPECT_EQ(shifted[i], rest[i]) << i;
  EXPECT_LT((shifted[20] - rest[20]).norm(), 0.006);
}

// A hand in motion as the app would send it, on both sides. Its errors are those of 21 landmarks
// (socket_trackers_test.cpp) and of the app's decimals.
Deviations Streamer::follow(const testing::MovingHand& moving) {
  Deviations deviations;
  StreamerDecoder decoder(moving.hand);
  for (const Side side : {Side::right, Side::left}) {
    for (const JointFrames& frame : moving.frames) {
      JointFrames sent = frame;
      if (side == Side::left) {
        for (Pose& joint : sent) {
          joint.position.x() *= -1;
          joint.orientation =
              Quaternion(joint.orientation.w(), joint.orientation.x(), -joint.orientation.y(), -joint.orientation.z());
        }
      }
      arrival_ += 11 * kMillisecond;
      decoder.take({streamer_hand(side, sent), arrival_, 0, false}, sink_);
      for (std::size_t j = 0; j < kJointCount; ++j) deviations.add(j, to_pose(sink_.newest.joints[j]), sent[j]);
    }
    EXPECT_EQ(sink_.newest.hand.side, static_cast<std::uint32_t>(side));
  }
  EXPECT_EQ(decoder.refusals().total(), 0u);
  deviations.print("streamer");
  return deviations;
}

TEST_F(Streamer, FollowsAGeneratedHandOnBothSides) {
  Deviations deviations = follow(testing::generated_hand(hand_));
  EXPECT_LT(deviations.distance(1), 0.5);
  EXPECT_LT(deviations.turn(1), 0.6);
}

TEST_F(Streamer, FollowsARecordedHandOnBothSides) {
  if (!std::filesystem::exists(testing::recorded_hand_path())) GTEST_SKIP() << "no " << testing::recorded_hand_path();
  Deviations deviations = follow(testing::recorded_hand(hand_));
  EXPECT_LT(deviations.distance(0.5), 0.8);
  EXPECT_LT(deviations.distance(0.99), 11);
  EXPECT_LT(deviations.turn(0.5), 2.4);
  EXPECT_LT(deviations.turn(0.99), 10);
}

TEST_F(Streamer, TakesLinesOfSeveralConnections) {
  const std::string left = streamer_hand(Side::left, mirrored(hand_).rest_joints);
  const std::string right = streamer_hand(Side::right, hand_.rest_joints);
  const auto line = [](const std::string& hand, int i) {
    const std::size_t end = hand.find('\n');
    return i == 0 ? hand.substr(0, end) : hand.substr(end + 1);
  };
  send(line(left, 0), 1);
  send(line(right, 0), 2);
  send(streamer_head({Vector3(1, 2, 3), Quaternion::Identity()}), 3);
  send(line(left, 1), 1);
  send(line(right, 1) + "\r", 2);
  EXPECT_EQ(sink_.hands, 2);
  EXPECT_EQ(sink_.heads, 1);
  EXPECT_EQ(to_vector(sink_.newest_head.position), Vector3(1, 2, 3));
  EXPECT_EQ(decoder_.refusals().total(), 0u);

  send(right + "\n" + right + "\n", 2);  // joined
  EXPECT_EQ(sink_.hands, 4);
  send(line(right, 1), 2);                         // no wrist
  send(line(left, 0) + "\n" + line(right, 1), 1);  // wrist of the other hand
  send(line(right, 0) + "\n" + right, 2);          // two wrists
  EXPECT_EQ(sink_.hands, 5);
  EXPECT_EQ(refused("unpaired"), 3);
  for (std::uint64_t connection = 10; connection < 30; ++connection) send(right, connection);
  EXPECT_EQ(sink_.hands, 25);
}

TEST_F(Streamer, AcceptsDecimalCommasAndDebugHeaders) {
  std::string commas = kDocumented;
  for (std::size_t i = 0; i + 1 < commas.size(); ++i)
    if (commas[i] == '.') commas[i] = ',';
  send(commas);
  ASSERT_EQ(sink_.hands, 1);
  const Vector3 tip = place(Joint::index_tip);
  send(kDocumented);
  EXPECT_EQ(tip, place(Joint::index_tip));

  // The headset's times: 10 ms apart, although Wi-Fi delivers two packets at once.
  for (std::uint64_t frame = 1; frame <= 50; ++frame) {
    const Nanoseconds before = sink_.newest.stamp.sample_time;
    const auto delayed = static_cast<Nanoseconds>(frame % 2 * 10 * kMillisecond);
    arrival_ =
        2'000'000 * kMillisecond + static_cast<Nanoseconds>(frame) * 10 * kMillisecond + delayed - 14 * kMillisecond;
    send(streamer_hand(Side::right, hand_.rest_joints, StreamerHeader{frame, 7'000'000'000 + frame * 10'000'000}));
    if (frame > 3) {
      EXPECT_EQ(sink_.newest.stamp.sample_time - before, 10 * kMillisecond) << frame;
    }
    EXPECT_LE(sink_.newest.stamp.sample_time, arrival_ + 1);
    EXPECT_EQ(sink_.newest.stamp.sequence, 2 + frame);
  }
  send(streamer_hand(Side::right, hand_.rest_joints, StreamerHeader{50, 7'500'000'000}));  // again
  EXPECT_EQ(refused("order"), 1);
  arrival_ += 5000 * kMillisecond;
  send(streamer_hand(Side::right, hand_.rest_joints, StreamerHeader{1, 1'000'000}));  // the headset started again
  EXPECT_EQ(refused("order"), 1);
  EXPECT_EQ(sink_.hands, 53);
}

TEST_F(Streamer, RefusesEveryTruncation) {
  for (std::size_t size = 1; size < kDocumented.size(); ++size) send(kDocumented.substr(0, size));
  EXPECT_EQ(sink_.hands, 0);
  EXPECT_EQ(decoder_.refusals().total(), kDocumented.size() - 1);
}

TEST_F(Streamer, RefusesBadDatagramsAsAWhole) {
  const auto changed = [](const std::string& from, const std::string& to) {
    std::string text = kDocumented;
    const std::size_t place = text.find(from);
    EXPECT_NE(place, std::string::npos) << from;
    return text.replace(place, from.size(), to);
  };
  const std::pair<std::string, const char*> cases[]{
      {"hello", "label"},
      {changed("Right wrist", "Middle wrist"), "label"},
      {changed("Right landmarks", "Right toes"), "label"},
      {changed("Right landmarks", "Left landmarks"), "unpaired"},
      {changed("wrist:", "wrist | f = x | t = 1:"), "label"},
      {changed("wrist:", "wrist | f = 1 | t = -1:"), "content"},
      {changed("wrist:", "wrist | f = 1 | t = 9000000000000000000:"), "content"},
      {changed("0.2502", "nan"), "numbers"},
      {changed("0.2502", "1e3"), "numbers"},
      {changed("0.2502", "2000.0000"), "content"},
      {changed("-0.970", "-0.870"), "content"},
      {changed("-0.970", "-0.970, 1.000"), "numbers"},
      {changed("0.0362", "0.9362"), "content"},
      {changed("0.0362", "0.0362 "), "numbers"},
      {changed("0.0362", "0.00.362"), "numbers"},
      {changed("0.0362", std::string(300, '0') + ".0362"), "numbers"},
      {kDocumented + ", 0.1000", "numbers"},
      {kDocumented + kDocumented, "numbers"},  // joined without a newline
      {kDocumented.substr(0, kDocumented.find('\n')), "unpaired"},
      {"Right wrist:, 0.0000, 0.0000, 0.0000, 0.000, 0.000, 0.000, 1.000\nRight landmarks:" +
           [] {
             std::string zeros;
             for (int i = 0; i < 63; ++i) zeros += ", 0.0000";
             return zeros;
           }(),
       "shape"},
      {std::string(4096, '\0'), "label"},
      {std::string(4096, '\n') + "x", "label"},
  };
  for (const auto& [text, reason] : cases) {
    const double before = refused(reason);
    const std::uint64_t total = decoder_.refusals().total();
    send(text);
    EXPECT_EQ(refused(reason), before + 1) << text.substr(0, 100);
    EXPECT_EQ(decoder_.refusals().total(), total + 1) << text.substr(0, 100);
  }
  EXPECT_EQ(sink_.hands, 0);
  send(kDocumented);
  EXPECT_EQ(sink_.hands, 1);
}

TEST_F(Streamer, DoesNotAllocate) {
  const std::string bad = kDocumented.substr(0, 200);
  const Arrival packets[]{{kDocumented, 0, 0, false}, {bad, 0, 0, false}};
  counting = true;
  for (int i = 0; i < 100; ++i) {
    Arrival packet = packets[i % 2];
    packet.time = arrival_ += kMillisecond;
    decoder_.take(packet, sink_);
  }
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_EQ(sink_.hands, 50);
}

}  // namespace
}  // namespace softhand::streamer_test
