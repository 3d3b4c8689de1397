// softhand-tracker-streamer with its simulator: UDP and TCP, power cycles, bad packets, and the latency that it adds.
#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <memory>
#include <string>
#include <vector>

#include "device/health.hpp"
#include "runtime/clock.hpp"
#include "support/tracker_process.hpp"
#include "trackers/streamer/simulated_streamer.hpp"

namespace softhand::streamer_process_test {
namespace {

class StreamerProcess : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { testing::use_own_domain(); }
  bool health(Health of) {
    return listener_.until([] {}, [&] { return listener_.counter("health") == static_cast<double>(of); });
  }
  std::unique_ptr<testing::Process> device(const std::string& transport, bool with_times) {
    std::vector<std::string> arguments{transport, std::to_string(transport == "udp" ? udp_ : tcp_)};
    if (with_times) arguments.emplace_back("times");
    return std::make_unique<testing::Process>("simulate-tracker-streamer", arguments, false);
  }
  int connect_to(int type, int port) const {
    const int number = socket(AF_INET, type, 0);
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<std::uint16_t>(port));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(connect(number, reinterpret_cast<const sockaddr*>(&to), sizeof to), 0);
    const int yes = 1;
    if (type == SOCK_STREAM) setsockopt(number, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    return number;
  }
  static void send_text(int number, const std::string& text) {
    EXPECT_EQ(::send(number, text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
  }

  testing::TrackerListener listener_;
  testing::Process tracker_{"softhand-tracker-streamer",
                            {"--config", std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml", "--set",
                             "tracker_streamer.udp_port=0", "--set", "tracker_streamer.tcp_port=0", "--source", "4"},
                            true};
  int udp_ = tracker_.number_after("UDP port ");
  int tcp_ = tracker_.number_after("TCP port ");
};

TEST_F(StreamerProcess, FollowsTheSimulatorThroughPowerCycles) {
  EXPECT_TRUE(health(Health::opening));
  for (const char* transport : {"udp", "tcp"}) {
    for (int cycle = 0; cycle < 2; ++cycle) {
      const auto simulator = device(transport, cycle == 1);
      ASSERT_TRUE(health(Health::live)) << transport << cycle;
      const int before = listener_.count;
      listener_.hands = {};
      listener_.head = {};
      ASSERT_TRUE(listener_.until([] {},
                                  [&] {
                                    return listener_.count > before + 50 && listener_.hands[0].source == 4 &&
                                           listener_.hands[1].source == 4 && listener_.head.valid == 1;
                                  }));
      for (const Skeleton& hand : listener_.hands) {
        for (const JointSample& joint : hand.joints) EXPECT_NE(joint.flags & kJointValid, 0u);
        EXPECT_LE(hand.stamp.sample_time, hand.stamp.publish_time);
        EXPECT_LT(now() - hand.stamp.sample_time, 500'000'000);
      }
      EXPECT_NEAR(listener_.head.position[1], 1.6, 1e-6);
      simulator->end(SIGKILL);
      ASSERT_TRUE(health(Health::lost)) << transport << cycle;
    }
  }
  EXPECT_EQ(listener_.counter("reconnects"), 3);  // the three connections of the second TCP simulator
  EXPECT_EQ(listener_.counter("connections"), 0);
  for (const char* reason : {"label", "numbers", "content", "unpaired", "shape", "order", "size"})
    EXPECT_EQ(listener_.counter(std::string("refused_") + reason), 0) << reason;
}

JointFrames joints_at(double x) {
  static const HandModel hand = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json");
  JointFrames joints = hand.rest_joints;
  const Vector3 offset = Vector3(x, 0, 0) - joints[1].position;
  for (Pose& joint : joints) joint.position += offset;
  return joints;
}

TEST_F(StreamerProcess, RefusesAndCountsBadPackets) {
  const std::string hand = streamer_hand(Side::right, joints_at(0.1));
  const int udp = connect_to(SOCK_DGRAM, udp_);
  send_text(udp, hand.substr(0, 300));               // truncated: numbers
  send_text(udp, hand + hand);                       // joined without a newline: numbers
  send_text(udp, hand.substr(0, hand.find('\n')));   // split: unpaired
  send_text(udp, hand.substr(hand.find('\n') + 1));  // split: unpaired
  send_text(udp, "something else");                  // label
  send_text(udp, std::string(5000, 'x'));            // size
  const int tcp = connect_to(SOCK_STREAM, tcp_);
  const std::string lines = hand + "\n" + hand + "\n";
  for (std::size_t i = 0; i < lines.size(); i += 100) {  // split and joined
    send_text(tcp, lines.substr(i, 100));
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  send_text(tcp, std::string(5000, 'x') + "\n" + hand);  // size, then a line without an end: cut
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("published") == 2; }));
  close(tcp);
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("refused_cut") == 1; }));
  EXPECT_EQ(listener_.counter("refused_numbers"), 2);
  EXPECT_EQ(listener_.counter("refused_unpaired"), 2);
  EXPECT_EQ(listener_.counter("refused_label"), 1);
  EXPECT_EQ(listener_.counter("refused_size"), 2);
  EXPECT_EQ(listener_.counter("published"), 2);
  close(udp);
}

TEST_F(StreamerProcess, LatencyAdded) {
  const std::string hand = streamer_hand(Side::right, joints_at(0.1));
  const int udp = connect_to(SOCK_DGRAM, udp_), tcp = connect_to(SOCK_STREAM, tcp_);
  testing::check_latency(listener_, "streamer, UDP", [&] { send_text(udp, hand); });
  testing::check_latency(listener_, "streamer, TCP", [&] { send_text(tcp, hand + "\n"); });
  close(udp);
  close(tcp);
}

}  // namespace
}  // namespace softhand::streamer_process_test
