// Every driver of a haptic or tactile device, and drivers that must fail, against the conformance kit.
#include "device/conformance.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "haptics/dhd/dhd.hpp"
#include "haptics/haply/haply.hpp"
#include "haptics/log/haptic_log_driver.hpp"
#include "haptics/opengloves/opengloves.hpp"
#include "haptics/openhaptics/openhaptics.hpp"
#include "haptics/sample/sample_glove.hpp"
#include "model/hand_model.hpp"
#include "tactile/bhaptics/bhaptics.hpp"
#include "tactile/log/tactile_log_driver.hpp"
#include "tactile/sample/sample_pad.hpp"
#include "tactile/weart/weart.hpp"

namespace softhand {
namespace {

template <typename Input>
std::string text_of(const std::function<std::shared_ptr<DeviceDriver<Input>>()>& make) {
  std::string text;
  for (const std::string& fault : conformance_faults<Input>(make)) text += fault + "\n";
  return text;
}

TEST(Conformance, SimulatedHapticGlove) {
  EXPECT_EQ(text_of<BoneWrench>([] { return std::make_shared<HapticLogDriver>(HapticLogOptions{}); }), "");
}

TEST(Conformance, SampleGlove) {
  EXPECT_EQ(text_of<BoneWrench>([] { return std::make_shared<SampleGlove>(SampleGloveOptions{}); }), "");
}

const HandModel& hand() {
  static const HandModel model = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json");
  return model;
}

TEST(Conformance, SimulatedTactileGlove) {
  EXPECT_EQ(text_of<SkinTraction>([] { return std::make_shared<TactileLogDriver>(TactileLogOptions{}, hand()); }), "");
}

TEST(Conformance, SamplePad) {
  EXPECT_EQ(text_of<SkinTraction>([] { return std::make_shared<SamplePad>(SamplePadOptions{}, hand()); }), "");
}

TEST(Conformance, OpenGloves) {
  OpenGlovesOptions options;
  options.port = 0;
  EXPECT_EQ(text_of<BoneWrench>([&] { return std::make_shared<OpenGloves>(options, hand()); }), "");
}

// No service listens at port 1.
TEST(Conformance, Haply) {
  HaplyOptions options;
  options.port = 1;
  options.event_port = 0;
  EXPECT_EQ(text_of<BoneWrench>([&] { return std::make_shared<Haply>(options, hand()); }), "");
}

TEST(Conformance, Bhaptics) {
  BhapticsOptions options;
  options.port = 1;
  EXPECT_EQ(text_of<SkinTraction>([&] { return std::make_shared<Bhaptics>(options, hand()); }), "");
}

TEST(Conformance, Weart) {
  WeartOptions options;
  options.port = 1;
  EXPECT_EQ(text_of<SkinTraction>([&] { return std::make_shared<Weart>(options, hand()); }), "");
}

TEST(Conformance, Dhd) {
  DhdOptions options;
  options.library = DHD_STAND_IN;
  EXPECT_EQ(text_of<BoneWrench>([&] { return std::make_shared<Dhd>(options, hand()); }), "");
}

TEST(Conformance, OpenHaptics) {
  OpenHapticsOptions options;
  options.library = HD_STAND_IN;
  EXPECT_EQ(text_of<BoneWrench>([&] { return std::make_shared<OpenHaptics>(options, hand()); }), "");
}

TEST(Conformance, EveryDriverIsTested) {
  std::ifstream in(std::string(SOFTHAND_SOURCE_DIR) + "/tests/unit/conformance_test.cpp");
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  int drivers = 0;
  for (const std::string kind : {"haptics", "tactile"}) {
    for (const auto& entry :
         std::filesystem::directory_iterator(std::string(SOFTHAND_SOURCE_DIR) + "/services/" + kind)) {
      if (!entry.is_directory()) continue;
      ++drivers;
      const std::string include = "#include \"" + kind + "/" + entry.path().filename().string() + "/";
      EXPECT_NE(text.find(include), std::string::npos) << entry.path() << ": add a test of this driver";
    }
  }
  EXPECT_GE(drivers, 4);
}

// The kit must find faults.
class Silent : public HapticDriver {
 public:
  DeviceLimits limits() const override { return {1, 0, 1, 100}; }
  void command(const BoneWrench&, std::span<double>) override {}
  void write(Nanoseconds, std::span<const double>) override {}
  bool release() override { return true; }
};
class Norm final : public Silent {
 public:
  void command(const BoneWrench& input, std::span<double> requested) override {
    requested[0] = to_vector(input.bones[2].coupling_force).norm();
  }
};
class Stuck final : public HapticDriver {
 public:
  DeviceLimits limits() const override { return {1, 0, 1, 100}; }
  void command(const BoneWrench& input, std::span<double> requested) override {
    requested[0] = input.bones[2].coupling_force[1];
  }
  void write(Nanoseconds, std::span<const double>) override {}
};
TEST(Conformance, FindsDriversThatKeepTheirForceWhileTheLoopHangs) {
  const std::string text = text_of<BoneWrench>([] { return std::make_shared<Stuck>(); });
  EXPECT_NE(text.find("pressing, hung loop: a command is not zero after 50 ms\n"), std::string::npos) << text;
  EXPECT_EQ(text.find("motors off"), std::string::npos) << text;
}
TEST(Conformance, FindsDriversThatFeelNothingOrAreNotLinear) {
  EXPECT_EQ(text_of<BoneWrench>([] { return std::make_shared<Silent>(); }).find("no command while pressing"), 0u);
  EXPECT_EQ(text_of<BoneWrench>([] { return std::make_shared<Norm>(); }),
            "command of actuator 0 is not linear in the forces\n");
}

}  // namespace
}  // namespace softhand
