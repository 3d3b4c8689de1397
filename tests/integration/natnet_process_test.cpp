// softhand-tracker-natnet with its simulator: unicast and multicast, 3.0 and 4.1, power cycles, bad packets, and the
// latency that it adds.
#include <poll.h>

#include <memory>
#include <string>
#include <vector>

#include "device/health.hpp"
#include "runtime/clock.hpp"
#include "support/free_port.hpp"
#include "support/tracker_process.hpp"
#include "trackers/natnet/simulated_motive.hpp"

namespace softhand::natnet_process_test {
namespace {

// Motive in the test's own hands.
class Server {
 public:
  explicit Server(int port) : socket_(socket(AF_INET, SOCK_DGRAM, 0)) {
    const sockaddr_in own = testing::loopback(port);
    EXPECT_EQ(bind(socket_, reinterpret_cast<const sockaddr*>(&own), sizeof own), 0);
  }
  ~Server() { close(socket_); }
  void answer() {
    char bytes[2048];
    socklen_t size = sizeof client_;
    for (ssize_t count; (count = recvfrom(socket_, bytes, sizeof bytes, MSG_DONTWAIT,
                                          reinterpret_cast<sockaddr*>(&client_), &size)) > 0;)
      send(motive_answer({bytes, static_cast<std::size_t>(count)}, {3, 0}, static_cast<std::uint64_t>(now()),
                         1'000'000'000, "", false));
  }
  void send(const std::string& packet) {
    if (packet.empty() || client_.sin_port == 0) return;
    sendto(socket_, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&client_), sizeof client_);
  }
  void show(double x = 0) {
    MotiveScene scene;
    scene.number = ++number_;
    scene.bodies = {{1, {Vector3(x, 1, 0), Quaternion::Identity()}, true}};
    scene.ticks.fill(static_cast<std::uint64_t>(now()));
    send(motive_frame({3, 0}, scene));
  }

 private:
  int socket_;
  sockaddr_in client_{};
  std::int32_t number_ = 0;
};

class NatNetProcess : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { testing::use_own_domain(); }
  void start(std::vector<std::string> options) {
    std::vector<std::string> arguments{"--config", std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml",
                                       "--source", "6"};
    options.push_back("command_port=" + std::to_string(port_));
    for (const std::string& option : options) {
      arguments.emplace_back("--set");
      arguments.push_back("tracker_natnet." + option);
    }
    tracker_ = std::make_unique<testing::Process>("softhand-tracker-natnet", arguments, true);
  }
  std::unique_ptr<testing::Process> motive(const std::vector<std::string>& words) const {
    std::vector<std::string> arguments{std::to_string(port_)};
    arguments.insert(arguments.end(), words.begin(), words.end());
    return std::make_unique<testing::Process>("simulate-tracker-natnet", arguments, true);
  }
  // True if hands arrive from a server in the test's own hands. Its version and its clock are known then.
  bool follows(Server& server) {
    return listener_.until(
        [&] {
          server.answer();
          server.show();
        },
        [&] { return listener_.counter("published") > 10; });
  }
  void expect_no_refusals() {
    for (const char* reason : {"content", "models", "shape", "order"})
      EXPECT_EQ(listener_.counter(std::string("refused_") + reason), 0) << reason;
    EXPECT_EQ(listener_.counter("passed_over"), 0);
  }

  testing::TrackerListener listener_;
  int port_ = testing::free_port(SOCK_DGRAM);
  std::unique_ptr<testing::Process> tracker_;
};

TEST_F(NatNetProcess, FollowsSkeletonsThroughPowerCycles) {
  start({"skeleton=Actor", "head.body=3", "bones=local", "up_axis=z"});
  EXPECT_TRUE(listener_.until_health(Health::opening));
  for (const char* version : {"3.0", "4.1", "4.0"}) {
    const auto simulator = motive({version, "local", "z-up"});
    ASSERT_TRUE(listener_.until_health(Health::live)) << version;
    ASSERT_TRUE(listener_.until_hands(6, true)) << version;
    for (const Skeleton& hand : listener_.hands) {
      for (const JointSample& joint : hand.joints) EXPECT_NE(joint.flags & kJointValid, 0u);
      // The exposure was 4 ms before the sending.
      EXPECT_GT(hand.stamp.publish_time - hand.stamp.sample_time, 3'000'000);
      EXPECT_LT(now() - hand.stamp.sample_time, 500'000'000);
    }
    EXPECT_NEAR(listener_.head.position[1], 1.6, 1e-6);
    simulator->end(SIGKILL);
    ASSERT_TRUE(listener_.until_health(Health::lost)) << version;
  }
  expect_no_refusals();
  EXPECT_EQ(listener_.counter("refused_size"), 0);
}

TEST_F(NatNetProcess, FollowsRigidBodiesByMulticast) {
  const std::string data = std::to_string(testing::free_port(SOCK_DGRAM));
  start({"left.body=1", "right.body=2", "head.body=3", "multicast=true", "data_port=" + data, "network=127.0.0.1"});
  for (const char* version : {"3.0", "4.1"}) {
    const auto simulator = motive({version, "multicast", data});
    ASSERT_TRUE(listener_.until_health(Health::live)) << version;
    ASSERT_TRUE(listener_.until_hands(6, true)) << version;
    EXPECT_EQ(listener_.hands[1].joints[5].flags, 0u);
    simulator->end(SIGKILL);
    ASSERT_TRUE(listener_.until_health(Health::lost)) << version;
  }
  expect_no_refusals();
  // The frames of the new version, until the server has said that it has another one.
  EXPECT_LT(listener_.counter("refused_size"), 60);
}

TEST_F(NatNetProcess, RefusesAndCountsBadPackets) {
  Server server(port_);
  start({"right.body=1"});
  ASSERT_TRUE(follows(server));
  const double before = listener_.counter("refused_size");
  EXPECT_EQ(before, 0);
  const std::string good = motive_frame({3, 0}, MotiveScene{});
  server.send(good.substr(0, 30));
  server.send(good + good);
  server.send(good.substr(30));
  server.send(motive_frame({4, 1}, MotiveScene{}));
  server.send(natnet_packet(NatNetMessage::models, "no models"));
  server.show(5000);
  EXPECT_TRUE(listener_.until([&] { server.answer(); },
                              [&] {
                                return listener_.counter("refused_size") == 4 &&
                                       listener_.counter("refused_models") == 1 &&
                                       listener_.counter("refused_content") == 1;
                              }));
}

TEST_F(NatNetProcess, LatencyAdded) {
  Server server(port_);
  start({"right.body=1"});
  ASSERT_TRUE(follows(server));
  testing::check_latency(listener_, "natnet", [&] {
    server.answer();
    server.show();
  });
}

}  // namespace
}  // namespace softhand::natnet_process_test
