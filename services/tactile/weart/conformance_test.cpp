// A TouchDIVER against the conformance kit.
#include "support/conformance.hpp"

#include "tactile/weart/simulated_touchdiver.hpp"
#include "tactile/weart/weart.hpp"

namespace softhand {
namespace {

// No middleware listens at port 1.
TEST(Conformance, Weart) {
  WeartOptions options;
  options.port = 1;
  EXPECT_EQ(
      testing::faults_of<SkinTraction>([&] { return std::make_shared<Weart>(options, testing::conformance_hand()); }),
      "");
}

TEST(ConformanceAtDevice, Weart) {
  EXPECT_EQ(testing::faults_at_device<SkinTraction>([]() -> DriverAtDevice<SkinTraction> {
              const auto device = std::make_shared<SimulatedTouchDiver>(0);
              WeartOptions options;
              options.port = device->port();
              const auto driver = std::make_shared<Weart>(options, testing::conformance_hand());
              testing::wait_for_device(*driver);
              return {driver, [device] { return device->effects().empty(); }};
            }),
            "");
}

}  // namespace
}  // namespace softhand
