// The conformance kit for drivers of haptic and tactile devices: it must find faults. The test of a driver is in the
// folder of the driver. The simulated gloves have no device: only their commands are tested.
#include "support/conformance.hpp"

#include "haptics/log/haptic_log_driver.hpp"
#include "tactile/log/tactile_log_driver.hpp"

namespace softhand {
namespace {

using testing::faults_of;

TEST(Conformance, SimulatedHapticGlove) {
  EXPECT_EQ(faults_of<BoneWrench>([] { return std::make_shared<HapticLogDriver>(HapticLogOptions{}); }), "");
}

TEST(Conformance, SimulatedTactileGlove) {
  EXPECT_EQ(faults_of<SkinTraction>(
                [] { return std::make_shared<TactileLogDriver>(TactileLogOptions{}, testing::conformance_hand()); }),
            "");
}

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
  const std::string text = faults_of<BoneWrench>([] { return std::make_shared<Stuck>(); });
  EXPECT_NE(text.find("pressing, hung loop: a command is not zero after 50 ms\n"), std::string::npos) << text;
  EXPECT_EQ(text.find("motors off"), std::string::npos) << text;
}
TEST(Conformance, FindsDriversThatFeelNothingOrAreNotLinear) {
  EXPECT_EQ(faults_of<BoneWrench>([] { return std::make_shared<Silent>(); }).find("no command while pressing"), 0u);
  EXPECT_EQ(faults_of<BoneWrench>([] { return std::make_shared<Norm>(); }),
            "command of actuator 0 is not linear in the forces\n");
}

// Its device gets zero when the driver ends, and after a quarter of a second, as with a buffer in between.
class Late final : public HapticDriver {
 public:
  explicit Late(std::shared_ptr<std::atomic<bool>> is_at_zero) : is_at_zero_(std::move(is_at_zero)) {}
  ~Late() override { *is_at_zero_ = true; }
  DeviceLimits limits() const override { return {1, 0, 1, 100}; }
  void command(const BoneWrench& input, std::span<double> requested) override {
    requested[0] = input.bones[2].coupling_force[1];
  }
  void write(Nanoseconds time, std::span<const double> commands) override {
    if (commands[0] != 0) pushed_ = time;
    *is_at_zero_ = time - pushed_ > 250'000'000;
  }
  bool release() override { return true; }

 private:
  std::shared_ptr<std::atomic<bool>> is_at_zero_;
  Nanoseconds pushed_ = 0;
};
TEST(ConformanceAtDevice, FindsDevicesThatAreLate) {
  const std::string text = testing::faults_at_device<BoneWrench>([]() -> DriverAtDevice<BoneWrench> {
    const auto is_at_zero = std::make_shared<std::atomic<bool>>(true);
    return {std::make_shared<Late>(is_at_zero), [is_at_zero] { return is_at_zero->load(); }};
  });
  for (const char* way : {"motors off", "gain 0", "no inputs", "hung loop", "dead simulation", "hung simulation"})
    EXPECT_NE(text.find(std::string("pressing, ") + way + ": the device is not at zero after 50 ms\n"),
              std::string::npos)
        << way << "\n"
        << text;
  EXPECT_EQ(text.find("end of the process"), std::string::npos) << text;
  EXPECT_EQ(text.find("in the air"), std::string::npos) << text;
}

}  // namespace
}  // namespace softhand
