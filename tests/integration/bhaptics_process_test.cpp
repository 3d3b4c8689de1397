// softhand-tactile-bhaptics with a simulated Player: intensities, power cycles, a dead client, bad messages, the end.
#include <limits>
#include <optional>
#include <string>

#include "device/health.hpp"
#include "support/device_process.hpp"
#include "support/press.hpp"
#include "tactile/bhaptics/simulated_player.hpp"

namespace softhand {
namespace {

using Motors = std::array<int, kGloveMotors>;

class BhapticsProcess : public testing::DeviceProcess<SkinTraction> {
 protected:
  BhapticsProcess() : DeviceProcess("tactile-bhaptics") {}
  void start_driver() {
    player_.emplace(0);
    start({"port=" + std::to_string(player_->port()), "full_scale_force=4"});
    ASSERT_TRUE(counts("glove_connected", 1));
  }
  void touch(int finger, double newton) { testing::press(input_, static_cast<Finger>(finger), newton); }
  bool has(Health health) { return counts("health", static_cast<double>(health)); }
  bool vibrates(const Motors& motors) {
    return push([&] { return player_->motors() == motors; });
  }

  std::optional<SimulatedPlayer> player_;
};

TEST_F(BhapticsProcess, VibratesWhereFingersTouch) {
  start_driver();
  EXPECT_EQ(player_->target(), "/v2/feedbacks?app_id=softhand&app_name=softhand");
  touch(1, 2);
  EXPECT_TRUE(vibrates({0, 50, 0, 0, 0, 0}));
  touch(1, 0);
  touch(0, 40);
  touch(5, 1);
  EXPECT_TRUE(vibrates({100, 0, 0, 0, 0, 25}));
  // A driver without input lets go after some milliseconds.
  EXPECT_TRUE(listener_.until([&] { write(); }, [&] { return listener_.counter("glove_intensity") == 100; }));
  touch(0, 0);
  touch(5, 0);
  EXPECT_TRUE(vibrates({}));
  // Nothing is sent while nothing touches.
  const int before = player_->messages();
  const Nanoseconds since = now();
  push([&] { return now() - since > 300'000'000; });
  EXPECT_LE(player_->messages(), before + 1);
  EXPECT_EQ(player_->mistakes(), 0);
  EXPECT_EQ(player_->turned_all_off(), 0);
}

TEST_F(BhapticsProcess, EveryEndIsZero) {
  start_driver();
  touch(1, 2);
  check_every_end([&] { return player_->motors()[1] == 50; }, [&] { return player_->motors() == Motors{}; });
  EXPECT_EQ(player_->turned_all_off(), 1);
}

// A client that is killed sends nothing more. Its last frame ends by itself.
TEST_F(BhapticsProcess, ADeadClientStops) {
  start_driver();
  touch(1, 2);
  ASSERT_TRUE(vibrates({0, 50, 0, 0, 0, 0}));
  driver_->end(SIGKILL);
  const double time = milliseconds_until([&] { return player_->motors() == Motors{}; }, now());
  std::printf("tactile-bhaptics, SIGKILL: zero after %.1f ms\n", time);
  EXPECT_LT(time, 200);
}

TEST_F(BhapticsProcess, ConnectsAgainAfterPowerCycles) {
  start_driver();
  const auto port = player_->port();
  touch(2, 4);
  for (int cycle = 1; cycle <= 2; ++cycle) {
    player_.reset();
    ASSERT_TRUE(counts("connections", 0));
    EXPECT_TRUE(has(Health::lost));
    player_.emplace(port);
    ASSERT_TRUE(counts("reconnects", cycle));
    EXPECT_TRUE(has(Health::live));
    EXPECT_TRUE(vibrates({0, 0, 100, 0, 0, 0})) << cycle;
  }
  player_.reset();
  ASSERT_TRUE(counts("connections", 0));
  const testing::Process simulator("simulate-tactile-bhaptics", {std::to_string(port)}, false);
  EXPECT_TRUE(counts("reconnects", 3));
}

TEST_F(BhapticsProcess, IsOpeningUntilThePlayerComes) {
  std::optional<SimulatedPlayer> before(0);
  const auto port = before->port();
  before.reset();
  start({"port=" + std::to_string(port)});
  EXPECT_TRUE(has(Health::opening));
  player_.emplace(port);
  EXPECT_TRUE(has(Health::live));
}

TEST_F(BhapticsProcess, RefusesAndCountsBadMessages) {
  start_driver();
  player_->send(R"({"ConnectedPositions":["Glove)");           // truncated
  player_->send(R"({"ConnectedPositions":[]}{"Status":{}})");  // joined
  player_->send(R"({"Status":{"GloveR":[1,2]}})");
  player_->send(R"({"Status":{"GloveR":[1,2,3,4,5,600]}})");
  EXPECT_TRUE(counts("refused_json", 2));
  EXPECT_TRUE(counts("refused_content", 1));
  EXPECT_TRUE(counts("refused_range", 1));
  player_->send(std::string(20000, ' '));
  EXPECT_TRUE(counts("refused_size", 1));
  touch(1, 2);
  EXPECT_TRUE(vibrates({0, 50, 0, 0, 0, 0}));
}

TEST_F(BhapticsProcess, LeavesOutSkinThatItCannotUse) {
  start_driver();
  touch(1, 2);
  touch(2, 2);
  input_.regions[1].pressure = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(vibrates({0, 50, 0, 0, 0, 0}));
  EXPECT_TRUE(listener_.until([&] { write(); }, [&] { return listener_.counter("refused_regions") > 0; }));
}

}  // namespace
}  // namespace softhand
