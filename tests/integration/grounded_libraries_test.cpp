// softhand-haptic-dhd and softhand-haptic-openhaptics with stand-in libraries: hands, forces, the local model, cables
// that are pulled out, absurd positions, the end.
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "haptics/dhd/stand_in.hpp"
#include "haptics/openhaptics/stand_in.hpp"
#include "runtime/exit_codes.hpp"
#include "support/device_process.hpp"
#include "support/shared_struct.hpp"

namespace softhand {
namespace {

struct DhdDevice {
  static constexpr const char* kModule = "haptic-dhd";
  static constexpr const char* kLibrary = DHD_STAND_IN;
  DhdDevice() : state(kDhdStandInFile) {}
  // In metres: x right, y up, z to the user.
  void move_to(const Vec3& p) {
    state->position[0] = p[2];
    state->position[1] = p[0];
    state->position[2] = p[1];
  }
  Vec3 force() { return {state->force[1], state->force[2], state->force[0]}; }
  void check() {}
  testing::SharedStruct<DhdStandIn> state;
};

struct HdDevice {
  static constexpr const char* kModule = "haptic-openhaptics";
  static constexpr const char* kLibrary = HD_STAND_IN;
  HdDevice() : state(kHdStandInFile) {}
  void move_to(const Vec3& p) {
    for (std::size_t i = 0; i < 3; ++i) state->position[i] = 1e3 * p[i];
  }
  Vec3 force() { return {state->force[0], state->force[1], state->force[2]}; }
  void check() { EXPECT_EQ(state->outside, 0); }
  testing::SharedStruct<HdStandIn> state;
};

template <typename Device>
class GroundedLibrary : public testing::GroundedProcess {
 protected:
  GroundedLibrary() : GroundedProcess(Device::kModule) {}
  void TearDown() override { device_.check(); }
  void start_driver(std::vector<std::string> settings = {}) {
    settings.push_back("library=" + std::string(Device::kLibrary));
    settings.emplace_back("maximum_force=2");
    start(settings);
    ASSERT_TRUE(health(Health::live));
  }
  bool feels(const Vec3& newton) {
    return push([&] { return (to_vector(device_.force()) - to_vector(newton)).norm() < 1e-6; });
  }

  Device device_;
};
using Devices = ::testing::Types<DhdDevice, HdDevice>;
struct Names {
  template <typename Device>
  static std::string GetName(int) {
    return std::is_same_v<Device, DhdDevice> ? "Dhd" : "OpenHaptics";
  }
};
TYPED_TEST_SUITE(GroundedLibrary, Devices, Names);

TYPED_TEST(GroundedLibrary, TracksTheHeldBoneAndPushesIt) {
  this->device_.move_to({0.01, 0.02, 0.03});
  this->start_driver({"base_position=[0, 1, 0.5]", "base_orientation=[0, 0.7071067811865476, 0, 0.7071067811865476]"});
  const Skeleton& hand = this->listener_.hands[1];
  const auto tip = static_cast<std::size_t>(index_of(Joint::index_tip));
  const auto is_at = [&](const Vector3& place) {
    return this->listener_.until([] {}, [&] { return (to_vector(hand.joints[tip].position) - place).norm() < 1e-9; });
  };
  // The device is turned by a quarter to the left: its right is away from the user.
  EXPECT_TRUE(is_at({0.03, 1.02, 0.49}));
  this->device_.move_to({0.01, 0.05, 0.03});
  EXPECT_TRUE(is_at({0.03, 1.05, 0.49}));
  EXPECT_EQ(hand.joints[tip].flags, kJointValid | kJointTracked);

  this->set_force(0.25, 1, -0.5);
  EXPECT_TRUE(this->feels({0.5, 1, 0.25}));
  EXPECT_TRUE(this->device_.state->is_enabled);
  this->set_force(0, -30, 0);
  EXPECT_TRUE(this->feels({0, -2, 0}));
}

TYPED_TEST(GroundedLibrary, ScalesMotionAndForceSoThatNoWorkIsLost) {
  this->device_.move_to({0, 0.02, 0});
  this->start_driver({"scale=3", "holds=hand"});
  const auto palm = static_cast<std::size_t>(index_of(Joint::palm));
  const Skeleton& hand = this->listener_.hands[1];
  EXPECT_TRUE(this->listener_.until(
      [] {}, [&] { return (to_vector(hand.joints[palm].position) - Vector3(0, 0.06, 0)).norm() < 1e-9; }));
  this->set_force(0, 0.25, 0);
  this->bone(Body::carpus).coupling_force = {0, 0.25, 0};
  EXPECT_TRUE(this->feels({0, 1.5, 0}));
}

TYPED_TEST(GroundedLibrary, EvaluatesThePlaneAtTheMeasuredPosition) {
  this->start_driver({"stiffness=500", "damping=0", "slew=100000"});
  this->input_.simulated_valid = 1;
  this->bone().contact_normal = {0, 1, 0};
  this->bone().contact_stiffness = 200;
  this->bone().contact_gap = 0.002;
  double felt = 0;
  for (int attempt = 0; attempt < 100 && std::abs(felt - 0.6) > 1e-6; ++attempt) {  // the machine may be busy
    this->device_.move_to({0, 0.01, 0});
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
    this->write();  // one message, while the cursor is 2 mm above the plane
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_NEAR(this->device_.force()[1], 0, 1e-6);
    this->device_.move_to({0, 0.005, 0});  // 3 mm into it
    const Nanoseconds since = now();
    while (now() - since < 20'000'000 && std::abs(felt - 0.6) > 1e-6) felt = this->device_.force()[1];
  }
  EXPECT_NEAR(felt, 0.6, 1e-6);
  EXPECT_TRUE(this->counts("planes", 1));
  // The work of the cursor and a force is observed.
  this->set_force(0, 1, 0);
  this->bone().contact_gap = 0;
  double height = 0.01;
  EXPECT_TRUE(this->listener_.until(
      [&] {
        this->device_.move_to({0, height -= 1e-5, 0});
        this->write();
      },
      [&] { return this->listener_.status.passivity_energy != 0; }));
}

TYPED_TEST(GroundedLibrary, EveryEndIsZero) {
  this->start_driver();
  this->set_force(0, 1, 0);
  this->check_every_end([&] { return this->device_.force()[1] == 1; },
                        [&] { return to_vector(this->device_.force()).isZero(0); });
  EXPECT_EQ(this->device_.state->closed, 1);
  EXPECT_TRUE(this->device_.state->was_zero_at_close);
}

TYPED_TEST(GroundedLibrary, IsAtZeroWhenAKilledDriverIsBack) {
  this->start_driver();
  this->set_force(0, 1, 0);
  this->check_restart_after_kill([&] { return this->device_.force()[1] == 1; },
                                 [&] { return to_vector(this->device_.force()).isZero(0); },
                                 [&] { this->start({"library=" + std::string(TypeParam::kLibrary)}); });
}

TYPED_TEST(GroundedLibrary, OpensAgainAfterTheCableWasOut) {
  this->start_driver();
  for (int cycle = 1; cycle <= 2; ++cycle) {
    this->device_.state->is_present = false;
    ASSERT_TRUE(this->health(Health::lost));
    this->device_.state->is_present = true;
    ASSERT_TRUE(this->health(Health::live));
    this->set_force(0, 1, 0);
    EXPECT_TRUE(this->feels({0, 1, 0})) << cycle;
    EXPECT_TRUE(this->counts("openings", cycle + 1));
    EXPECT_EQ(this->device_.state->closed, cycle);
    EXPECT_TRUE(this->device_.state->was_zero_at_close);
  }
  EXPECT_TRUE(this->counts("device_errors", 2));
}

TYPED_TEST(GroundedLibrary, RefusesAbsurdPositions) {
  this->start_driver();
  for (const double absurd :
       {std::numeric_limits<double>::quiet_NaN(), 1e9, -std::numeric_limits<double>::infinity()}) {
    const double before = this->listener_.counter("refused_range");
    this->device_.move_to({0, absurd, 0});
    EXPECT_TRUE(this->listener_.until([] {}, [&] { return this->listener_.counter("refused_range") > before + 10; }));
    this->device_.move_to({0, 0, 0});
    EXPECT_TRUE(this->health(Health::live));
  }
  for (const JointSample& joint : this->listener_.hands[1].joints) EXPECT_TRUE(all_finite(joint.position));
}

// `softhand up` does not start it again.
TYPED_TEST(GroundedLibrary, AMissingLibraryIsAnErrorOfTheConfiguration) {
  this->start({"library=/nowhere/libmissing.so"});
  const int status = this->driver_->end(SIGTERM);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), kExitConfiguration);
}

class OpenHapticsProcess : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { testing::use_own_domain(); }
  void start() {
    listener_.module = HdDevice::kModule;
    driver_.emplace("softhand-haptic-openhaptics",
                    std::vector<std::string>{"--config", std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/pinch.toml",
                                             "--set", "haptic_openhaptics.library=" + std::string(HdDevice::kLibrary)},
                    true);
    ASSERT_TRUE(counts("openings", 1));
  }
  bool counts(const std::string& counter, double value) {
    return listener_.until([] {}, [&] { return listener_.counter(counter) == value; });
  }
  HdDevice device_;
  testing::TrackerListener listener_;
  std::optional<testing::Process> driver_;
};

// A force error of the vendor's library, as motors that are too warm, is no reason to close the device.
TEST_F(OpenHapticsProcess, CountsForceErrors) {
  start();
  device_.state->error = 0x0200;
  EXPECT_TRUE(listener_.until([] {}, [&] { return listener_.counter("device_errors") > 10; }));
  EXPECT_EQ(listener_.counter("openings"), 1);
}

// Errors wait in the library until somebody asks. Those of earlier calls say nothing about this device.
TEST_F(OpenHapticsProcess, OpensTheDeviceWhateverErrorsWait) {
  device_.state->older_errors = 3;
  start();
  EXPECT_EQ(device_.state->opened, 1);
}

TEST_F(OpenHapticsProcess, ClosesADeviceThatOpenedWithAnError) {
  device_.state->init_error = 0x0301;
  start();
  EXPECT_EQ(device_.state->opened, 2);
  EXPECT_EQ(device_.state->closed, 1);
}

TEST_F(OpenHapticsProcess, SeesAnErrorBehindAForceError) {
  start();
  device_.state->error = 0x0200;
  device_.state->older_errors = 1;
  EXPECT_TRUE(counts("openings", 2));
}

}  // namespace
}  // namespace softhand
