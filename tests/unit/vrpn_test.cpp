// VRPN: messages to the byte, wrists and a head, new connections, and malformed messages.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <optional>
#include <string>

#include "messages/convert.hpp"
#include "support/count_allocations.hpp"
#include "support/counters.hpp"
#include "support/tracker_sink.hpp"
#include "trackers/vrpn/simulated_vrpn.hpp"
#include "trackers/vrpn/vrpn_server.hpp"

namespace softhand::vrpn_test {
namespace {

constexpr Nanoseconds kMillisecond = 1'000'000;
using namespace std::string_literals;

using Sink = testing::TrackerSamples;

VrpnOptions options_of_three() {
  VrpnOptions options;
  options.left.sensor = 0;
  options.right.sensor = 1;
  options.head.sensor = 2;
  return options;
}

class Vrpn : public ::testing::Test {
 protected:
  // The bytes of a connection, divided as the intake does it.
  void send(const std::string& bytes) {
    arrival_ += kMillisecond;
    std::string_view rest = bytes;
    while (!rest.empty()) {
      const std::size_t size = vrpn_packet_size(rest);
      ASSERT_GT(size, 0u);
      ASSERT_LE(size, rest.size());
      decoder_->take({rest.substr(0, size), arrival_, connection_, false}, sink_);
      rest.remove_prefix(size);
    }
  }
  void greet() {
    ++connection_;
    send(vrpn_greeting());
  }
  std::string pose(std::int32_t sensor, const Pose& pose) { return vrpn_pose(5, 3, arrival_ + kOffset, sensor, pose); }
  double refused(const std::string& name) const {
    LoopStatus status;
    decoder_->refusals().fill_status(status, 0);
    return testing::counter_of(status, "refused_" + name);
  }
  const JointSample& wrist(std::size_t side) const {
    return sink_.hands[side].joints[static_cast<std::size_t>(index_of(Joint::wrist))];
  }

  static constexpr Nanoseconds kOffset = 1'000'000'000'000'000;
  std::optional<VrpnDecoder> decoder_{options_of_three()};
  Sink sink_;
  std::uint64_t connection_ = 0;
  Nanoseconds arrival_ = 1'000'000 * kMillisecond;
};

TEST_F(Vrpn, MessagesAreReadToTheByte) {
  EXPECT_EQ(vrpn_cookie(), "vrpn: ver. 07.35  0\0\0\0\0\0"s);
  // Made up by hand from the description of the protocol. Header: 31 bytes, 1 s, 2 us, number 3, type -1, unused.
  const std::string name =
      "\0\0\0\x21\0\0\0\1\0\0\0\2\0\0\0\3\xff\xff\xff\xff\0\0\0\0"s  // 33 = 24 + 9 bytes
      "\0\0\0\5Hand\0\0\0\0\0\0\0\0"s;
  const auto message = read_vrpn(name);
  ASSERT_TRUE(message);
  EXPECT_EQ(message->sent, 1'000'002'000);
  EXPECT_EQ(message->sender, 3);
  EXPECT_EQ(message->type, VrpnMessage::kSender);
  EXPECT_EQ(read_vrpn_name(message->payload), "Hand");
  EXPECT_EQ(read_vrpn_name("\0\0\0\4Hand"s), "Hand");  // without the zero
  EXPECT_EQ(vrpn_packet_size(name), 40u);
  EXPECT_EQ(vrpn_message(-1, 3, 1'000'002'000, "\0\0\0\5Hand\0"s), name);

  const std::string packet = vrpn_pose(5, 3, 0, 2, {Vector3(1, -2, 0.5), Quaternion(0.6, 0, 0.8, 0)});
  EXPECT_EQ(packet.size(), 24u + 64);
  EXPECT_EQ(packet.substr(24, 16), "\0\0\0\2\0\0\0\0\x3f\xf0\0\0\0\0\0\0"s);
  const auto seen = read_vrpn_pose(read_vrpn(packet)->payload);
  ASSERT_TRUE(seen);
  EXPECT_EQ(seen->sensor, 2);
  EXPECT_EQ(seen->pose.position, Vector3(1, -2, 0.5));
  EXPECT_EQ(seen->pose.orientation.y(), 0.8);
  for (std::size_t size = 0; size < packet.size(); ++size) EXPECT_FALSE(read_vrpn(packet.substr(0, size))) << size;
  EXPECT_FALSE(read_vrpn(packet + packet));
  EXPECT_FALSE(read_vrpn(packet + std::string(8, '\0')));
  EXPECT_FALSE(read_vrpn_pose(packet.substr(24, 63)));
  EXPECT_FALSE(read_vrpn_pose(packet.substr(24) + '\0'));
  // Too small and negative sizes are not of this protocol, and nothing is known of less than four bytes.
  EXPECT_GT(vrpn_packet_size("\0\0\0\x17"s), kLargestVrpnMessage);
  EXPECT_GT(vrpn_packet_size("\xff\0\0\x17"s), kLargestVrpnMessage);
  EXPECT_EQ(vrpn_packet_size("\0\0\0"s), 0u);
  EXPECT_EQ(vrpn_packet_size(vrpn_cookie().substr(0, 5)), 24u);
}

TEST_F(Vrpn, SensorsAreWristsAndAHead) {
  greet();
  const Pose there{Vector3(0.2, 1, -0.3), Quaternion(0.6, 0, 0.8, 0)};
  send(pose(0, there) + pose(1, there) + pose(2, there) + pose(7, there));
  ASSERT_EQ(sink_.count, 2);
  ASSERT_EQ(sink_.heads, 1);
  for (std::size_t side = 0; side < 2; ++side) {
    EXPECT_LT((to_vector(wrist(side).position) - there.position).norm(), 1e-12);
    EXPECT_EQ(wrist(side).flags, kJointValid | kJointTracked);
    EXPECT_EQ(sink_.hands[side].joints[0].flags, 0u);
    EXPECT_EQ(sink_.hands[side].confidence, 1);
  }
  EXPECT_EQ(sink_.newest_head.valid, 1u);
  EXPECT_EQ(decoder_->refusals().total(), 0u);
}

TEST_F(Vrpn, UnitsAxesAndMountsAreOptions) {
  VrpnOptions options = options_of_three();
  options.scale = 0.001;
  options.up_axis = "z";
  options.right.mount = {{0, -0.1, 0}, {0, 0.8, 0, 0.6}};
  decoder_.emplace(options);
  greet();
  // 1 m to the right, 2 m ahead, 1.5 m up, turned about the vertical.
  const Quaternion turn(Eigen::AngleAxisd(0.4, Vector3::UnitZ()));
  send(pose(1, {Vector3(1000, 2000, 1500), turn}));
  const Pose expected = Pose{Vector3(1, 1.5, -2), Quaternion(Eigen::AngleAxisd(0.4, Vector3::UnitY()))} *
                        Pose{Vector3(0, -0.1, 0), Quaternion(0.6, 0, 0.8, 0)};
  EXPECT_LT((to_vector(wrist(1).position) - expected.position).norm(), 1e-12);
  EXPECT_LT(to_quaternion(wrist(1).orientation).angularDistance(expected.orientation), 1e-7);
  options.left.mount.orientation = {0, 0, 0, 2};
  EXPECT_THROW(VrpnDecoder{options}, std::invalid_argument);
}

TEST_F(Vrpn, TimesAreThoseOfTheServer) {
  greet();
  send(pose(1, {}));  // sent 0 ms before its arrival, as 1 ms passes in `send`
  const Nanoseconds sent = arrival_ + kOffset;
  arrival_ += 10 * kMillisecond;
  send(vrpn_pose(5, 3, sent + 2 * kMillisecond, 1, {}));  // it took longer
  EXPECT_NEAR(static_cast<double>(arrival_ - sink_.hands[1].stamp.sample_time) * 1e-6, 8, 0.01);
  send(vrpn_pose(5, 3, sent + 2 * kMillisecond, 1, {}));
  EXPECT_EQ(refused("order"), 1);
  send(vrpn_pose(5, 3, 0, 1, {}));
  EXPECT_EQ(sink_.hands[1].stamp.sample_time, arrival_);
  EXPECT_EQ(sink_.hands[1].stamp.sequence, 3u);
}

TEST_F(Vrpn, NumbersAreThoseOfTheConnection) {
  greet();
  send(pose(1, {}));
  EXPECT_EQ(sink_.count, 1);
  ++connection_;
  send(vrpn_cookie());
  send(pose(1, {}));  // its type has no name yet
  EXPECT_EQ(sink_.count, 1);
  send(vrpn_name(VrpnMessage::kType, 9, kVrpnPoseType) + vrpn_name(VrpnMessage::kSender, 8, "Tracker0"));
  send(pose(1, {}));
  EXPECT_EQ(sink_.count, 1);
  send(vrpn_pose(9, 8, 0, 1, {}));
  EXPECT_EQ(sink_.count, 2);
  EXPECT_EQ(decoder_->refusals().total(), 0u);
}

TEST_F(Vrpn, RefusesBadMessagesAndReadsOverOthers) {
  send(pose(1, {}));  // no cookie
  EXPECT_EQ(refused("version"), 1);
  std::string other = vrpn_cookie();
  other[12] = '8';  // 08.35
  send(other);
  EXPECT_EQ(refused("version"), 2);
  greet();
  send(vrpn_message(5, 3, 0, "short"));
  send(vrpn_message(-1, 3, 0, "short"));
  send(vrpn_message(-2, 3, 0, ""));
  std::string time = pose(1, {});
  time[8] = '\x7f';  // microseconds
  send(time);
  EXPECT_EQ(refused("format"), 4);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  send(pose(1, {Vector3(0, nan, 0), Quaternion::Identity()}));
  send(pose(1, {Vector3(2000, 0, 0), Quaternion::Identity()}));
  send(pose(1, {Vector3::Zero(), Quaternion(2, 0, 0, 0)}));
  send(pose(1, {Vector3::Zero(), Quaternion(nan, 0, 0, 0)}));
  EXPECT_EQ(refused("content"), 4);
  EXPECT_EQ(sink_.count, 0);
  send(vrpn_message(4, 3, 0, "a velocity") + vrpn_message(-4, 0, 0, "a log") + vrpn_pose(5, 0, 0, 1, {}));
  EXPECT_EQ(decoder_->refusals().total(), 10u);
  EXPECT_EQ(sink_.count, 0);
}

TEST_F(Vrpn, DoesNotAllocate) {
  greet();
  std::string packets[100];
  for (int i = 0; i < 100; ++i) packets[i] = vrpn_pose(5, 3, arrival_ + i * 1000, i % 3, {});
  counting = true;
  for (const std::string& packet : packets) decoder_->take({packet, arrival_ += 1000, connection_, false}, sink_);
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_EQ(sink_.count + sink_.heads, 100);
}

}  // namespace
}  // namespace softhand::vrpn_test
