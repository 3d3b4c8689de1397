// A Force Dimension device, by the stand-in for its library, against the conformance kit.
#include "support/conformance.hpp"

#include "haptics/dhd/dhd.hpp"
#include "haptics/dhd/stand_in.hpp"
#include "support/shared_struct.hpp"

namespace softhand {
namespace {

TEST(Conformance, Dhd) {
  DhdOptions options;
  options.library = DHD_STAND_IN;
  EXPECT_EQ(testing::faults_of<BoneWrench>([&] { return std::make_shared<Dhd>(options, testing::conformance_hand()); }),
            "");
}

TEST(ConformanceAtDevice, Dhd) {
  EXPECT_EQ(testing::faults_at_device<BoneWrench>([]() -> DriverAtDevice<BoneWrench> {
              using Device = testing::SharedStruct<DhdStandIn>;
              const auto device = std::make_shared<Device>(kDhdStandInFile);
              DhdOptions options;
              options.library = DHD_STAND_IN;
              const auto driver = std::make_shared<Dhd>(options, testing::conformance_hand());
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
