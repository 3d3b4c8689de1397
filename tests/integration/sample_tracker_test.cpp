// The sample driver: the page shows its code, and its simulator's packets become hands.
#include <arpa/inet.h>
#include <sys/socket.h>

#include <fstream>
#include <iterator>
#include <optional>

#include "device/health.hpp"
#include "runtime/clock.hpp"
#include "support/tracker_process.hpp"

namespace softhand::sample_tracker_test {
namespace {

std::string text_of(const std::string& path) {
  std::ifstream in(std::string(SOFTHAND_SOURCE_DIR) + "/" + path);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

TEST(SampleTracker, ThePageShowsItsCode) {
  const std::string page = text_of("docs/add-a-tracker.md");
  for (const char* file : {"CMakeLists.txt", "sample_options.hpp", "driver.cpp", "main.cpp"}) {
    const std::string code = text_of(std::string("services/trackers/sample/") + file);
    ASSERT_FALSE(code.empty()) << file;
    EXPECT_NE(page.find("\n" + code + "```\n"), std::string::npos) << "docs/add-a-tracker.md differs from " << file;
  }
}

TEST(SampleTracker, FollowsItsSimulatorThroughAPowerCycle) {
  testing::use_own_domain();
  testing::TrackerListener listener;
  const testing::Process tracker("softhand-tracker-sample",
                                 {"--config", std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml", "--set",
                                  "tracker_sample.port=0", "--source", "3"},
                                 true);
  const auto health = [&](Health of) {
    return listener.until([] {}, [&] { return listener.counter("health") == static_cast<double>(of); });
  };
  EXPECT_TRUE(health(Health::opening));
  const std::string port = std::to_string(tracker.number_after("UDP port "));
  std::optional<testing::Process> device;
  device.emplace("simulate-tracker-sample", std::vector<std::string>{port}, false);
  ASSERT_TRUE(health(Health::live));
  ASSERT_TRUE(listener.until([] {}, [&] { return listener.count > 20; }));
  const Skeleton& hand = listener.hands[1];
  EXPECT_EQ(hand.source, 3u);
  EXPECT_EQ(hand.joints[1].flags, kJointValid | kJointTracked);
  EXPECT_EQ(hand.joints[2].flags, 0u);
  EXPECT_NEAR(std::hypot(hand.joints[1].position[0], hand.joints[1].position[2]), 0.1, 1e-6);
  EXPECT_LT(now() - hand.stamp.sample_time, 500'000'000);

  device->end(SIGKILL);
  ASSERT_TRUE(health(Health::lost));
  device.emplace("simulate-tracker-sample", std::vector<std::string>{port}, false);
  ASSERT_TRUE(health(Health::live));

  const int bad = socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(std::stoi(port)));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  for (const std::size_t size : {0u, 27u, 28u, 29u, 100u})  // 28 zero bytes have no orientation
    sendto(bad, std::string(size, '\0').data(), size, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  EXPECT_TRUE(listener.until([] {}, [&] { return listener.counter("refused") == 5; }));
  close(bad);
}

}  // namespace
}  // namespace softhand::sample_tracker_test
