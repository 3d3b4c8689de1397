// softhand-tracker-leap with its simulator and with a library in place of LeapC: power cycles, bad messages, and the
// latency that it adds.
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <vector>

#include "device/health.hpp"
#include "device/simulated_service.hpp"
#include "runtime/clock.hpp"
#include "support/free_port.hpp"
#include "support/tracker_process.hpp"
#include "trackers/leap/simulated_leap.hpp"

namespace softhand {
namespace {

class LeapProcess : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { testing::use_own_domain(); }
  void start(const std::vector<std::string>& options) {
    std::vector<std::string> arguments{"--config", std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml",
                                       "--source", "8"};
    for (const std::string& option : options) {
      arguments.emplace_back("--set");
      arguments.push_back("tracker_leap." + option);
    }
    tracker_ = std::make_unique<testing::Process>("softhand-tracker-leap", arguments, true);
  }
  void start_socket() { start({"port=" + std::to_string(port_)}); }

  testing::TrackerListener listener_;
  int port_ = testing::free_port(SOCK_STREAM);
  std::unique_ptr<testing::Process> tracker_;
};

TEST_F(LeapProcess, FollowsTheSimulatorThroughPowerCycles) {
  start_socket();
  EXPECT_TRUE(listener_.until_health(Health::opening));
  for (const char* service : {"current", "old", "beta"}) {
    testing::Process simulator("simulate-tracker-leap", {std::to_string(port_), service}, true);
    ASSERT_TRUE(listener_.until_health(Health::live)) << service;
    ASSERT_TRUE(listener_.until_hands(8, false)) << service;
    for (const Skeleton& hand : listener_.hands) {
      EXPECT_EQ(hand.frame, 2u);
      for (const JointSample& joint : hand.joints) EXPECT_NE(joint.flags & kJointValid, 0u);
      EXPECT_NEAR(hand.joints[1].position[1], 0.2, 0.02) << service;
      EXPECT_LE(hand.stamp.sample_time, hand.stamp.publish_time);
      EXPECT_LT(now() - hand.stamp.sample_time, 500'000'000);
    }
    simulator.end(SIGKILL);
    ASSERT_TRUE(listener_.until_health(Health::lost)) << service;
  }
  EXPECT_EQ(listener_.counter("reconnects"), 2);
  for (const char* reason : {"json", "content", "shape", "order", "size"})
    EXPECT_EQ(listener_.counter(std::string("refused_") + reason), 0) << reason;
}

JointFrames joints() {
  static const HandModel hand = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json");
  return above_camera(hand.rest_joints, 0.1);
}
std::string good_frame() { return leap_frame_message(now() / 1000, {{Side::right, joints()}}, LeapService::current); }

TEST_F(LeapProcess, RefusesAndCountsBadMessages) {
  std::vector<std::string> received;
  SimulatedService service(port_, {[](const std::string& target) {
                                     EXPECT_EQ(target, "/v6.json");
                                     return std::string(kLeapServiceGreeting);
                                   },
                                   [&](const std::string& message) {
                                     received.push_back(message);
                                     return std::string();
                                   },
                                   nullptr});
  start_socket();
  ASSERT_TRUE(listener_.until([&] { service.send(good_frame()); }, [&] { return listener_.counter("published") > 5; }));
  service.send(good_frame().substr(0, 500));
  service.send(good_frame() + good_frame());
  service.send(R"({"hands":[],"pointables":7,"timestamp":1})");
  EXPECT_TRUE(listener_.until(
      [] {}, [&] { return listener_.counter("refused_json") == 2 && listener_.counter("refused_content") == 1; }));
  service.send(std::string(70'000, ' '));  // too large: the connection is closed and opened again
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("refused_size") == 1; }));
  const double before = listener_.counter("published");
  EXPECT_TRUE(listener_.until([&] { service.send(good_frame()); },
                              [&] { return listener_.counter("published") > before + 5; }));
  EXPECT_EQ(listener_.counter("reconnects"), 1);
  tracker_.reset();
  ASSERT_GE(received.size(), 3u);
  EXPECT_EQ(received[0], R"({"background":true})");
  EXPECT_EQ(received[1], R"({"focused":true})");
  EXPECT_EQ(received[2], R"({"optimizeHMD":false})");
}

TEST_F(LeapProcess, LatencyAdded) {
  SimulatedService service(port_, {});
  start_socket();
  ASSERT_TRUE(listener_.until([&] { service.send(good_frame()); }, [&] { return listener_.counter("published") > 5; }));
  // The making of a message does not count.
  std::vector<std::string> messages;
  for (std::int64_t i = 0; i < 1000; ++i)
    messages.push_back(leap_frame_message(now() / 1000 + 10'000 * i, {{Side::right, joints()}}, LeapService::current));
  std::size_t next = 0;
  testing::check_latency(listener_, "leap, WebSocket", [&] { service.send(messages[next++]); });
}

TEST_F(LeapProcess, FollowsALibraryInPlaceOfLeapCThroughPowerCycles) {
  const std::string file = ::testing::TempDir() + "softhand_leap_service_" + std::to_string(getpid());
  setenv("STAND_IN_SERVICE", file.c_str(), 1);
  start({"source=leapc", "library=" STAND_IN_LEAPC});
  EXPECT_TRUE(listener_.until_health(Health::opening));
  for (int cycle = 0; cycle < 2; ++cycle) {
    std::ofstream(file) << "on";
    ASSERT_TRUE(listener_.until_health(Health::live)) << cycle;
    ASSERT_TRUE(listener_.until_hands(8, false)) << cycle;
    for (std::size_t side = 0; side < 2; ++side) {
      const JointSample& wrist = listener_.hands[side].joints[1];
      EXPECT_NEAR(wrist.position[0], side == 0 ? -0.1 : 0.1, 1e-6);
      EXPECT_NEAR(listener_.hands[side].joints[10].position[2], -0.145, 1e-6);  // the tip of the index finger
      EXPECT_NEAR(listener_.hands[side].joints[10].radius, 0.008, 1e-6);
    }
    std::filesystem::remove(file);
    ASSERT_TRUE(listener_.until_health(Health::lost)) << cycle;
  }
  EXPECT_EQ(listener_.counter("reconnects"), 1);
  // The stand-in stamps a frame when it delivers it.
  std::ofstream(file) << "on";
  testing::check_stamped_latency(listener_, "leap, LeapC");
  std::filesystem::remove(file);
}

TEST_F(LeapProcess, AMissingLibraryIsTriedAgain) {
  start({"source=leapc", "library=/nowhere/libLeapC.so"});
  EXPECT_TRUE(listener_.until_health(Health::opening));
  EXPECT_EQ(listener_.counter("connections"), 0);
  const int status = tracker_->end(SIGTERM);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

}  // namespace
}  // namespace softhand
