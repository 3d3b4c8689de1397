// The sample pad against the conformance kit.
#include "support/conformance.hpp"

#include "sample_pad.hpp"
#include "support/force_packets.hpp"

namespace softhand {
namespace {

using testing::conformance_hand;

TEST(Conformance, SamplePad) {
  EXPECT_EQ(testing::faults_of<SkinTraction>(
                [] { return std::make_shared<SamplePad>(SamplePadOptions{}, conformance_hand()); }),
            "");
}

TEST(ConformanceAtDevice, SamplePad) {
  using Pad = testing::ForcePackets<27>;
  EXPECT_EQ(testing::faults_at_device<SkinTraction>([]() -> DriverAtDevice<SkinTraction> {
              const auto pad = std::make_shared<Pad>();
              SamplePadOptions options;
              options.port = pad->port();
              return {std::make_shared<SamplePad>(options, conformance_hand()),
                      [pad] { return pad->forces() == Pad::Forces{}; }};
            }),
            "");
}

}  // namespace
}  // namespace softhand
