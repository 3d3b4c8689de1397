// softhand-tracker-vrpn with its simulator: power cycles, bad streams, and the latency that it adds.
#include <netinet/tcp.h>

#include <memory>
#include <string>
#include <vector>

#include "device/health.hpp"
#include "runtime/clock.hpp"
#include "support/free_port.hpp"
#include "support/tracker_process.hpp"
#include "trackers/vrpn/simulated_vrpn.hpp"

namespace softhand::vrpn_process_test {
namespace {

class VrpnProcess : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { testing::use_own_domain(); }

  testing::TrackerListener listener_;
  int port_ = testing::free_port(SOCK_STREAM);
  testing::Process tracker_{"softhand-tracker-vrpn",
                            {"--config", std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml", "--set",
                             "tracker_vrpn.port=" + std::to_string(port_), "--set", "tracker_vrpn.left.sensor=0",
                             "--set", "tracker_vrpn.right.sensor=1", "--set", "tracker_vrpn.head.sensor=2", "--set",
                             "tracker_vrpn.up_axis=z", "--source", "7"},
                            true};
};

TEST_F(VrpnProcess, FollowsTheSimulatorThroughPowerCycles) {
  EXPECT_TRUE(listener_.until_health(Health::opening));
  for (int cycle = 0; cycle < 3; ++cycle) {
    testing::Process simulator("simulate-tracker-vrpn", {std::to_string(port_), "z-up"}, true);
    ASSERT_TRUE(listener_.until_health(Health::live)) << cycle;
    ASSERT_TRUE(listener_.until_hands(7, true)) << cycle;
    for (const Skeleton& hand : listener_.hands) {
      EXPECT_NEAR(hand.joints[1].position[1], 1.1, 1e-6);
      EXPECT_LE(hand.stamp.sample_time, hand.stamp.publish_time);
      EXPECT_LT(now() - hand.stamp.sample_time, 500'000'000);
    }
    EXPECT_NEAR(listener_.head.position[1], 1.6, 1e-6);
    simulator.end(SIGKILL);
    ASSERT_TRUE(listener_.until_health(Health::lost)) << cycle;
  }
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("connections") == 0; }));
  EXPECT_EQ(listener_.counter("reconnects"), 2);
  for (const char* reason : {"version", "format", "content", "order", "size"})
    EXPECT_EQ(listener_.counter(std::string("refused_") + reason), 0) << reason;
}

// A server in the test's own hands.
class Server {
 public:
  explicit Server(int port) : listening_(socket(AF_INET, SOCK_STREAM, 0)) {
    const sockaddr_in own = testing::loopback(port);
    const int yes = 1;
    setsockopt(listening_, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    EXPECT_EQ(bind(listening_, reinterpret_cast<const sockaddr*>(&own), sizeof own), 0);
    EXPECT_EQ(listen(listening_, 1), 0);
  }
  ~Server() {
    hang_up();
    close(listening_);
  }
  // Waits for the client and its cookie.
  void accept_client() {
    client_ = accept(listening_, nullptr, nullptr);
    const int yes = 1;
    setsockopt(client_, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    char bytes[24];
    EXPECT_EQ(recv(client_, bytes, sizeof bytes, MSG_WAITALL), 24);
    EXPECT_EQ(std::string(bytes, 24), vrpn_cookie());
  }
  void send(const std::string& bytes) {
    EXPECT_EQ(::send(client_, bytes.data(), bytes.size(), MSG_NOSIGNAL), static_cast<ssize_t>(bytes.size()));
  }
  void hang_up() {
    if (client_ >= 0) close(client_);
    client_ = -1;
  }

 private:
  int listening_, client_ = -1;
};

TEST_F(VrpnProcess, RefusesAndCountsBadStreams) {
  Server server(port_);
  server.accept_client();
  const auto pose = [](double x) { return vrpn_pose(5, 3, 0, 1, {Vector3(x, 0, 0), Quaternion::Identity()}); };
  const std::string stream = vrpn_greeting() + pose(0) + pose(1);
  for (std::size_t i = 0; i < stream.size(); i += 50) {  // split and joined
    server.send(stream.substr(i, 50));
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  server.send(pose(5000) + vrpn_message(5, 3, 0, "no pose"));
  EXPECT_TRUE(listener_.until(
      [] {}, [&] { return listener_.counter("refused_content") == 1 && listener_.counter("refused_format") == 1; }));
  EXPECT_EQ(listener_.counter("published"), 2);
  server.send(pose(0).substr(0, 40));  // a cut message
  server.hang_up();
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("refused_cut") == 1; }));
  // Bytes that are not of this protocol close the connection. It is opened again.
  server.accept_client();
  server.send(std::string(100, '\xff'));
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("refused_size") == 1; }));
  server.hang_up();
  server.accept_client();
  server.send(pose(0));  // without a cookie
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("refused_version") == 1; }));
  server.send(vrpn_greeting() + pose(0));
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("published") == 3; }));
}

TEST_F(VrpnProcess, LatencyAdded) {
  Server server(port_);
  server.accept_client();
  server.send(vrpn_greeting());
  testing::check_latency(listener_, "vrpn", [&] { server.send(vrpn_pose(5, 3, now(), 1, {})); });
}

}  // namespace
}  // namespace softhand::vrpn_process_test
