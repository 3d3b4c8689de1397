// softhand-tracker-osc with its simulator: single messages and bundles, power cycles, bad packets, added latency.
#include <arpa/inet.h>
#include <sys/socket.h>

#include <memory>
#include <string>
#include <vector>

#include "device/health.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "support/tracker_process.hpp"
#include "trackers/osc/simulated_performer.hpp"

namespace softhand::osc_process_test {
namespace {

class OscProcess : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { testing::use_own_domain(); }
  OscProcess() : socket_(socket(AF_INET, SOCK_DGRAM, 0)) {
    to_.sin_family = AF_INET;
    to_.sin_port = htons(static_cast<std::uint16_t>(port_));
    to_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  }
  ~OscProcess() override { close(socket_); }
  bool health(Health of) {
    return listener_.until([] {}, [&] { return listener_.counter("health") == static_cast<double>(of); });
  }
  void send(const std::string& packet) {
    sendto(socket_, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to_), sizeof to_);
  }

  testing::TrackerListener listener_;
  testing::Process tracker_{"softhand-tracker-osc",
                            {"--config", std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml", "--set",
                             "tracker_osc.port=0", "--set", "tracker_osc.right_tracker=1", "--source", "5"},
                            true};
  int port_ = tracker_.number_after("UDP port ");
  int socket_;
  sockaddr_in to_{};
};

TEST_F(OscProcess, FollowsTheSimulatorThroughPowerCycles) {
  EXPECT_TRUE(health(Health::opening));
  for (const bool is_bundle : {false, true}) {
    std::vector<std::string> arguments{std::to_string(port_)};
    if (is_bundle) arguments.emplace_back("bundle");
    const auto simulator = std::make_unique<testing::Process>("simulate-tracker-osc", arguments, false);
    ASSERT_TRUE(health(Health::live)) << is_bundle;
    listener_.hands = {};
    listener_.head = {};
    const int before = listener_.count;
    ASSERT_TRUE(listener_.until([] {},
                                [&] {
                                  return listener_.count > before + 50 && listener_.hands[0].source == 5 &&
                                         listener_.hands[1].source == 5 && listener_.head.valid == 1;
                                }));
    for (const Skeleton& hand : listener_.hands) EXPECT_LE(hand.stamp.sample_time, hand.stamp.publish_time);
    simulator->end(SIGKILL);
    ASSERT_TRUE(health(Health::lost)) << is_bundle;
  }
  EXPECT_EQ(listener_.counter("passed_over"), 0);
  for (const char* reason : {"format", "content", "shape", "size"})
    EXPECT_EQ(listener_.counter(std::string("refused_") + reason), 0) << reason;
  // Each kill may cut a frame.
  EXPECT_LE(listener_.counter("refused_incomplete"), 1);
}

TEST_F(OscProcess, FollowsPlainHands) {
  const testing::Process simulator("simulate-tracker-osc", {std::to_string(port_), "plain"}, false);
  ASSERT_TRUE(health(Health::live));
  const auto closes = [&](const Skeleton& hand) {
    const auto at = [&](Joint joint) { return to_vector(hand.joints[slot_of(joint)].position); };
    return hand.frame == 0 && (at(Joint::index_tip) - at(Joint::wrist)).norm() < 0.12;
  };
  EXPECT_TRUE(listener_.until([] {}, [&] { return closes(listener_.hands[0]) && closes(listener_.hands[1]); }));
  EXPECT_EQ(listener_.counter("refused_content"), 0);
}

TEST_F(OscProcess, RefusesAndCountsBadPackets) {
  const std::string good = osc_message("/VMC/Ext/Bone/Pos", "LeftHand", {0, 0, 0, 0, 0, 0, 1});
  send(good.substr(0, 50));  // truncated
  send(good + good);         // joined
  send(good.substr(20));     // split
  send(osc_message("/VMC/Ext/Bone/Pos", "LeftHand", {0, 0, 0, 0, 0, 0, 3}));
  send(std::string(9000, '/'));
  EXPECT_TRUE(listener_.until([] {},
                              [&] {
                                return listener_.counter("refused_format") == 3 &&
                                       listener_.counter("refused_content") == 1 &&
                                       listener_.counter("refused_size") == 1;
                              }));
  EXPECT_EQ(listener_.counter("published"), 0);
}

TEST_F(OscProcess, LatencyAdded) {
  const std::string packet = osc_bundle({osc_message("/tracking/trackers/1/position", "", {1, 0, 0}),
                                         osc_message("/tracking/trackers/1/rotation", "", {0, 0, 0})});
  testing::check_latency(listener_, "osc", [&] { send(packet); });
}

}  // namespace
}  // namespace softhand::osc_process_test
