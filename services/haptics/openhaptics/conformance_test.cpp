// A Touch, by the stand-in for its library, against the conformance kit.
#include "support/conformance.hpp"

#include "haptics/openhaptics/openhaptics.hpp"
#include "haptics/openhaptics/stand_in.hpp"
#include "support/shared_struct.hpp"

namespace softhand {
namespace {

TEST(Conformance, OpenHaptics) {
  OpenHapticsOptions options;
  options.library = HD_STAND_IN;
  EXPECT_EQ(testing::faults_of<BoneWrench>(
                [&] { return std::make_shared<OpenHaptics>(options, testing::conformance_hand()); }),
            "");
}

TEST(ConformanceAtDevice, OpenHaptics) {
  EXPECT_EQ(testing::faults_at_device<BoneWrench>([]() -> DriverAtDevice<BoneWrench> {
              using Device = testing::SharedStruct<HdStandIn>;
              const auto device = std::make_shared<Device>(kHdStandInFile);
              OpenHapticsOptions options;
              options.library = HD_STAND_IN;
              const auto driver = std::make_shared<OpenHaptics>(options, testing::conformance_hand());
              testing::wait_for_device(*driver);
              return {driver, [device] {
                        const auto& force = (*device)->force;
                        return force[0] == 0 && force[1] == 0 && force[2] == 0;
                      }};
            }),
            "");
}

}  // namespace
}  // namespace softhand
