// A TactGlove against the conformance kit.
#include "support/conformance.hpp"

#include "tactile/bhaptics/bhaptics.hpp"
#include "tactile/bhaptics/simulated_player.hpp"

namespace softhand {
namespace {

// No service listens at port 1.
TEST(Conformance, Bhaptics) {
  BhapticsOptions options;
  options.port = 1;
  EXPECT_EQ(testing::faults_of<SkinTraction>(
                [&] { return std::make_shared<Bhaptics>(options, testing::conformance_hand()); }),
            "");
}

// At a low rate each frame would end before the next one.
TEST(Conformance, BhapticsRefusesALowRate) {
  BhapticsOptions options;
  options.port = 1;
  const auto driver = std::make_shared<Bhaptics>(options, testing::conformance_hand());
  EXPECT_THROW(DeviceLoop<SkinTraction>({.rate_hz = 90}, driver, 1, 1), std::invalid_argument);
  EXPECT_NO_THROW(DeviceLoop<SkinTraction>({.rate_hz = 100}, driver, 1, 1));
}

TEST(ConformanceAtDevice, Bhaptics) {
  EXPECT_EQ(testing::faults_at_device<SkinTraction>([]() -> DriverAtDevice<SkinTraction> {
              const auto player = std::make_shared<SimulatedPlayer>(0);
              BhapticsOptions options;
              options.port = player->port();
              const auto driver = std::make_shared<Bhaptics>(options, testing::conformance_hand());
              return {driver, [player] { return player->motors() == std::array<int, kGloveMotors>{}; }};
            }),
            "");
}

}  // namespace
}  // namespace softhand
