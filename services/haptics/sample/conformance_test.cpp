// The sample glove against the conformance kit.
#include "support/conformance.hpp"

#include "sample_glove.hpp"
#include "support/force_packets.hpp"

namespace softhand {
namespace {

TEST(Conformance, SampleGlove) {
  EXPECT_EQ(testing::faults_of<BoneWrench>([] { return std::make_shared<SampleGlove>(SampleGloveOptions{}); }), "");
}

TEST(ConformanceAtDevice, SampleGlove) {
  using Glove = testing::ForcePackets<kFingerCount>;
  EXPECT_EQ(testing::faults_at_device<BoneWrench>([]() -> DriverAtDevice<BoneWrench> {
              const auto glove = std::make_shared<Glove>();
              SampleGloveOptions options;
              options.port = glove->port();
              return {std::make_shared<SampleGlove>(options), [glove] { return glove->forces() == Glove::Forces{}; }};
            }),
            "");
}

}  // namespace
}  // namespace softhand
