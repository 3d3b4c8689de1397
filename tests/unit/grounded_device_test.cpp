// Grounded devices: what the cursor holds, the exchange with the thread of the device, and measured velocities.
#include "device/grounded_device.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <limits>
#include <thread>

#include "support/count_allocations.hpp"
#include "support/counters.hpp"

namespace softhand::grounded_device_test {
namespace {

constexpr Nanoseconds kMillisecond = 1'000'000, kStart = 5'000'000'000;

const HandModel& hand() {
  static const HandModel model = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json");
  return model;
}
BoneSample& bone(BoneWrench& input, Body body) { return input.bones[static_cast<std::size_t>(index_of(body))]; }
const JointSample& joint(const Skeleton& skeleton, Joint which) {
  return skeleton.joints[static_cast<std::size_t>(index_of(which))];
}
Vector3 command_of(const GroundedPointOptions& options, const BoneWrench& input) {
  Vec3 out{};
  GroundedPoint(options, hand()).command(input, out);
  return to_vector(out);
}

TEST(GroundedPoint, FeelsWhatTheCursorHolds) {
  BoneWrench input;
  bone(input, Body::index_distal).coupling_force = {1, 2, 3};
  bone(input, Body::thumb_distal).coupling_force = {10, 20, 30};
  EXPECT_EQ(command_of({}, input), Vector3(1, 2, 3));
  EXPECT_EQ(command_of({.holds = "thumb_distal"}, input), Vector3(10, 20, 30));
  EXPECT_EQ(command_of({.holds = "hand"}, input), Vector3(11, 22, 33));
  EXPECT_EQ(command_of({.scale = 2}, input), Vector3(2, 4, 6));
  // The device stands to the right of the user and faces left: its right is the world's -Z.
  const double half = std::sqrt(0.5);
  EXPECT_LT((command_of({.base_orientation = {0, half, 0, half}}, input) - Vector3(-3, 2, 1)).norm(), 1e-12);
  EXPECT_THROW(GroundedPoint({.base_orientation = {0, 0, 0, 0}}, hand()), std::invalid_argument);
}

TEST(GroundedPoint, PutsTheHeldBoneAtTheCursor) {
  Skeleton open, other;
  GroundedPoint({.base_position = {0, 1, 0}, .scale = 2}, hand()).lift({0.1, 0, 0.05}, open);
  EXPECT_LT((to_vector(joint(open, Joint::index_tip).position) - Vector3(0.2, 1, 0.1)).norm(), 1e-12);
  EXPECT_EQ(joint(open, Joint::index_tip).flags, kJointValid | kJointTracked);
  EXPECT_EQ(joint(open, Joint::wrist).flags, kJointValid | kJointInferred);
  EXPECT_EQ(open.frame, 0u);
  EXPECT_EQ(open.confidence, 1);
  EXPECT_EQ(open.hand.side, 1u);
  GroundedPoint({.holds = "hand"}, hand()).lift({0, 0, 0}, other);
  EXPECT_LT(to_vector(joint(other, Joint::palm).position).norm(), 1e-12);
  // The hand is the same, and does not turn.
  const auto span = [](const Skeleton& skeleton) {
    return Vector3(to_vector(joint(skeleton, Joint::little_tip).position) -
                   to_vector(joint(skeleton, Joint::wrist).position));
  };
  EXPECT_LT((span(open) - span(other)).norm(), 1e-12);
}

// Its thread is played by the test.
class Device final : public GroundedDevice {
 public:
  Device() : GroundedDevice({.maximum_force = 5, .slew = 1e5, .stiffness = 1000, .damping = 10}, hand()) {}
  using GroundedDevice::force;
  using GroundedDevice::moved;
  using GroundedDevice::set_open;
};
class Hands final : public TrackerSink {
 public:
  void hand(const Skeleton& sample) override {
    newest = sample;
    ++count;
  }
  void head(const HeadPose&) override {}
  Skeleton newest;
  int count = 0;
};

TEST(GroundedDevice, ExchangesTheNewestValues) {
  Device device;
  Hands hands;
  Vec3 position{};
  EXPECT_FALSE(device.measure(kStart, position));
  EXPECT_FALSE(device.state().connected);
  device.set_open(true);
  device.moved(kStart - 1, {1, 1, 1});
  device.moved(kStart, {0.1, 0.2, 0.3});
  device.poll(kStart + kMillisecond, hands);
  EXPECT_TRUE(device.state().connected);
  ASSERT_TRUE(device.measure(kStart + kMillisecond, position));
  EXPECT_EQ(position, (Vec3{0.1, 0.2, 0.3}));
  EXPECT_EQ(hands.count, 1);
  EXPECT_EQ(hands.newest.stamp.sample_time, kStart);
  // Old positions are no motion.
  device.poll(kStart + 51 * kMillisecond, hands);
  EXPECT_FALSE(device.measure(kStart, position));
  EXPECT_EQ(hands.count, 1);
  // Hands are published at 250 Hz.
  for (int i = 1; i <= 1000; ++i) {
    device.moved(kStart + i * kMillisecond, {});
    device.poll(kStart + i * kMillisecond, hands);
  }
  EXPECT_EQ(hands.count, 251);
  device.set_open(false);
  device.poll(kStart + 1000 * kMillisecond, hands);
  EXPECT_FALSE(device.measure(kStart, position));
}

// A device whose loop and thread go on for some milliseconds, while the loop asks for (0, 2, 0) N.
class PushedDevice : public ::testing::Test {
 protected:
  PushedDevice() { device_.set_open(true); }
  // Returns the force of the last millisecond.
  double run(int milliseconds) {
    double force = 0;
    for (int i = 0; i < milliseconds; ++i) {
      time_ += kMillisecond;
      if (loop_steps_) device_.write(time_, Vec3{0, 2, 0});
      device_.moved(time_, {0, height_, 0});
      force = device_.force(time_)[1];
    }
    return force;
  }
  Device device_;
  Nanoseconds time_ = kStart;
  double height_ = 0.1;
  bool loop_steps_ = true;
};

TEST_F(PushedDevice, BeginsSoftlyWithEachOpening) {
  for (int opening = 0; opening < 2; ++opening) {
    EXPECT_EQ(run(1), 0) << opening;
    EXPECT_NEAR(run(250), 1, 1e-9) << opening;
    EXPECT_EQ(run(250), 2) << opening;
    EXPECT_EQ(run(1000), 2) << opening;
    device_.set_open(false);
    device_.set_open(true);
  }
}

TEST_F(PushedDevice, LetsGoIfTheLoopStandsStillAndBeginsSoftlyAgain) {
  EXPECT_EQ(device_.force(kStart), Vec3{});
  EXPECT_EQ(run(600), 2);
  loop_steps_ = false;
  EXPECT_EQ(run(19), 2);
  EXPECT_EQ(run(1), 0);
  loop_steps_ = true;
  EXPECT_NEAR(run(6), 0.02, 1e-9);
  EXPECT_EQ(run(600), 2);
}

TEST_F(PushedDevice, LetsGoIfItsSensorFailsAndBeginsSoftlyAgain) {
  EXPECT_EQ(run(600), 2);
  for (const double absurd : {std::numeric_limits<double>::quiet_NaN(), 1.1}) {
    height_ = absurd;
    EXPECT_EQ(run(49), 2);
    EXPECT_EQ(run(1), 0);
    EXPECT_EQ(run(100), 0);
    height_ = 0.1;
    EXPECT_NEAR(run(6), 0.02, 1e-9);
    EXPECT_EQ(run(600), 2);
  }
}

// At a low rate the device would let go between two steps.
TEST(GroundedDevice, RefusesALowRate) {
  EXPECT_THROW(DeviceLoop<BoneWrench>({.rate_hz = 140}, std::make_shared<Device>(), 1, 0), std::invalid_argument);
  EXPECT_NO_THROW(DeviceLoop<BoneWrench>({.rate_hz = 150}, std::make_shared<Device>(), 1, 0));
}

// The observer counts the work of the force that acted, not of the one that the loop has just commanded.
TEST(GroundedDevice, KnowsWhichForceActed) {
  Device device;
  Hands hands;
  Vec3 acted{};
  const auto acted_at = [&](Nanoseconds time) {
    device.moved(time, {});
    device.poll(time, hands);
    EXPECT_TRUE(device.measure_commands(acted));
    return acted;
  };
  device.set_open(true);
  for (Nanoseconds time = kStart - 600 * kMillisecond; time < kStart; time += kMillisecond) {  // forces begin softly
    device.write(time, Vec3{});
    device.moved(time, {});
    device.force(time);
  }
  device.write(kStart, Vec3{1, 2, 3});
  EXPECT_EQ(acted_at(kStart + 1), Vec3{});
  device.force(kStart + 1);
  device.write(kStart + 2, Vec3{4, 5, 6});
  EXPECT_EQ(acted_at(kStart + 2), (Vec3{1, 2, 3}));
  device.force(kStart + 2);
  EXPECT_EQ(acted_at(kStart + 3), (Vec3{4, 5, 6}));
  device.force(kStart + 21 * kMillisecond);  // the loop stands still
  EXPECT_EQ(acted_at(kStart + 22 * kMillisecond), Vec3{});
}

class Late final : public HapticDriver {
 public:
  DeviceLimits limits() const override { return {1, -10, 10, 1e6, 1000, 10}; }
  void command(const BoneWrench& input, std::span<double> requested) override {
    requested[0] = input.bones[0].coupling_force[0];
  }
  bool measure(Nanoseconds, std::span<double> positions) override {
    positions[0] = position;
    return true;
  }
  bool measure_commands(std::span<double> commands) override {
    commands[0] = acted;
    return knows;
  }
  void write(Nanoseconds, std::span<const double>) override {}
  double position = 0, acted = 0;
  bool knows = true;
};
TEST(DeviceLoop, ObservesTheCommandsThatActed) {
  for (const bool knows : {true, false}) {
    const auto driver = std::make_shared<Late>();
    driver->knows = knows;
    DeviceLoop<BoneWrench> loop({}, driver, 1, 0);
    BoneWrench input;
    input.simulated_valid = 1;
    input.stamp = {1, 1, 0, kStart, kStart, {}};
    input.bones[0].coupling_force = {2, 0, 0};
    loop.step(kStart, &input);
    loop.step(kStart + kMillisecond, nullptr);
    EXPECT_EQ(loop.commands()[0], 2);
    driver->position = -0.001;  // against the command
    driver->acted = 0.5;
    loop.step(kStart + 2 * kMillisecond, nullptr);
    EXPECT_NEAR(loop.feedback().passivity().energy(), knows ? 0.5e-3 : 2e-3, 1e-12);
  }
}

TEST(GroundedDevice, RefusesAbsurdPositions) {
  Device device;
  Hands hands;
  device.set_open(true);
  device.moved(kStart, {0.1, 0, 0});
  for (const double absurd : {1.1, -1e300, std::numeric_limits<double>::quiet_NaN()})
    device.moved(kStart + 1, {0, absurd, 0});
  device.poll(kStart, hands);
  Vec3 position{};
  ASSERT_TRUE(device.measure(kStart, position));
  EXPECT_EQ(position[0], 0.1);
  EXPECT_EQ(device.state().refused, 3u);
  LoopStatus status;
  device.fill_status(status);
  EXPECT_EQ(testing::counter_of(status, "refused_range"), 3);
  EXPECT_EQ(testing::counter_of(status, "openings"), 1);
}

TEST(GroundedDevice, DoesNotAllocate) {
  Device device;
  Hands hands;
  const auto input = std::make_unique<BoneWrench>();
  Vec3 values{};
  device.set_open(true);
  counting = true;
  for (int i = 0; i < 10; ++i) {
    device.moved(kStart + i * 5 * kMillisecond, {0.1, 0, 0});
    device.poll(kStart + i * 5 * kMillisecond, hands);
    device.measure(kStart, values);
    device.command(*input, values);
    device.write(kStart, values);
    device.force(kStart);
  }
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_EQ(hands.count, 10);
}

TEST(LatestValue, IsNeverTorn) {
  struct Pair {
    std::uint64_t a = 0, b = 0;
  };
  LatestValue<Pair> value;
  std::atomic<bool> stop{false};
  std::thread other([&] {
    for (std::uint64_t i = 1; !stop; ++i) value.store({i, ~i});
  });
  std::uint64_t newest = 0, loads = 0;
  while (loads < 10000) {
    Pair pair;
    if (!value.load(pair)) continue;
    ++loads;
    ASSERT_EQ(pair.a, ~pair.b);
    ASSERT_GT(pair.a, newest);
    newest = pair.a;
  }
  stop = true;
  other.join();
}

TEST(DeviceMotion, UsesMeasuredVelocities) {
  DeviceMotion motion(2);
  const std::array<double, 2> measured{0.5, -0.25}, absurd{0.5, 11};
  for (int i = 0; i < 10; ++i) motion.add(kStart + i * kMillisecond, std::array<double, 2>{0.001 * i, 0});
  EXPECT_NEAR(motion.velocities()[0], 1, 1e-9);
  EXPECT_TRUE(motion.set_velocities(measured));
  EXPECT_EQ(motion.velocities()[0], 0.5);
  EXPECT_EQ(motion.velocities()[1], -0.25);
  EXPECT_FALSE(motion.set_velocities(absurd));
  EXPECT_NEAR(motion.velocities()[0], 1, 1e-9);
  EXPECT_FALSE(motion.set_velocities(std::array<double, 2>{0, std::numeric_limits<double>::quiet_NaN()}));
  // They belong to one step only.
  EXPECT_TRUE(motion.set_velocities(measured));
  motion.add(kStart + 10 * kMillisecond, std::array<double, 2>{0.01, 0});
  EXPECT_NEAR(motion.velocities()[0], 1, 1e-9);
}

}  // namespace
}  // namespace softhand::grounded_device_test
