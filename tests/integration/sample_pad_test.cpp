// The sample pad: the page shows its code, the traction of the simulation becomes packets, and every end is zero.
#include <cmath>
#include <fstream>
#include <iterator>

#include "support/device_process.hpp"
#include "support/force_packets.hpp"
#include "support/press.hpp"

namespace softhand::sample_pad_test {
namespace {

std::string text_of(const std::string& path) {
  std::ifstream in(std::string(SOFTHAND_SOURCE_DIR) + "/" + path);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

TEST(SamplePad, ThePageShowsItsCode) {
  const std::string page = text_of("docs/add-a-device.md");
  const std::string code = text_of("services/tactile/sample/sample_pad.hpp");
  ASSERT_FALSE(code.empty());
  EXPECT_NE(page.find("\n" + code + "```\n"), std::string::npos) << "docs/add-a-device.md differs from sample_pad.hpp";
}

class SamplePadProcess : public testing::DeviceProcess<SkinTraction> {
 protected:
  SamplePadProcess() : DeviceProcess("tactile-sample") {}
  using Pad = testing::ForcePackets<27>;

  Pad pad_;
};

TEST_F(SamplePadProcess, PinsPressAndShearAndEveryEndIsZero) {
  start({"port=" + std::to_string(pad_.port()), "maximum_force=5"}, false);
  testing::press(input_, Finger::index, 2, 0.1);
  // The friction on the skin is against the slip, away from the tip. The pins are on a round surface.
  EXPECT_TRUE(push([&] {
    float press = 0, along = 0;
    for (std::size_t pin = 0; pin < 9; ++pin) {
      along += pad_.forces()[3 * pin];
      press += pad_.forces()[3 * pin + 2];
    }
    return press > 1.8f && press <= 2 && std::abs(along + 1) < 0.01f;
  }));
  const Pad::Forces forces = pad_.forces();
  for (const std::size_t corner : {2, 8, 20, 26}) EXPECT_GT(forces[14], 2 * forces[corner]) << "N, the middle one";
  // The thumb is not on the pad.
  testing::press(input_, Finger::thumb, 2);
  testing::press(input_, Finger::index, 0);
  EXPECT_TRUE(push([&] { return pad_.forces() == Pad::Forces{}; }));
  testing::press(input_, Finger::index, 2);
  check_every_end([&] { return pad_.forces()[14] > 0.3f; }, [&] { return pad_.forces() == Pad::Forces{}; });
}

}  // namespace
}  // namespace softhand::sample_pad_test
