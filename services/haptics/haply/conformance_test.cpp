// An Inverse3 against the conformance kit.
#include "support/conformance.hpp"

#include "haptics/haply/haply.hpp"
#include "haptics/haply/simulated_inverse3.hpp"

namespace softhand {
namespace {

// No service listens at port 1.
TEST(Conformance, Haply) {
  HaplyOptions options;
  options.port = 1;
  options.event_port = 0;
  EXPECT_EQ(
      testing::faults_of<BoneWrench>([&] { return std::make_shared<Haply>(options, testing::conformance_hand()); }),
      "");
}

TEST(ConformanceAtDevice, Haply) {
  EXPECT_EQ(testing::faults_at_device<BoneWrench>([]() -> DriverAtDevice<BoneWrench> {
              const auto device = std::make_shared<SimulatedInverse3>(0, 0);
              HaplyOptions options;
              options.port = device->port();
              options.event_port = device->event_port();
              const auto driver = std::make_shared<Haply>(options, testing::conformance_hand());
              testing::wait_for_device(*driver);
              return {driver, [device] { return device->force() == SimulatedInverse3::Force{}; }};
            }),
            "");
}

}  // namespace
}  // namespace softhand
