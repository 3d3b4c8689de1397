// A wall that is felt through the local model, with the delay, jitter and loss of a real rig.
#include <gtest/gtest.h>

#include "wall/virtual_wall.hpp"

namespace softhand::wall {
namespace {

TEST(VirtualWall, IsStableAndPassiveAtFiveTimesTheStiffness) {
  for (const Device& device : kDevices) {
    const double held = largest_stiffness(device, {}, Mode::held, false);
    EXPECT_GT(held, 0) << device.name;
    const Result five = worst({device, {}, {}, 5 * held, Mode::near, 0});
    EXPECT_TRUE(five.passive()) << device.name << ": " << 5 * held << " N/m, " << five.lowest_energy << " J";
    EXPECT_TRUE(five.stable()) << device.name << ": " << 5 * held << " N/m, " << five.ripple << " m";
    // A Touch has less force than five times would need.
    if (5 * held <= device.stiffness) {
      EXPECT_NEAR(five.rendered, 5 * held, 0.02 * 5 * held) << device.name;
    }
  }
}

TEST(VirtualWall, FeelsAsStiffAsTheDeviceCan) {
  for (const Device& device : kDevices) {
    const Result result = worst({device, {}, {}, device.stiffness, Mode::near, 0});
    EXPECT_TRUE(result.stable() && result.passive()) << device.name;
    EXPECT_NEAR(result.rendered, device.stiffness, 0.02 * device.stiffness) << device.name;
  }
}

TEST(VirtualWall, HeldForcesGiveEnergyAtAnyStiffness) {
  // The test of passivity can fail: the device of today is not passive even where it is stable.
  for (const Device& device : kDevices) EXPECT_FALSE(worst({device, {}, {}, 50, Mode::held, 0}).passive());
}

TEST(VirtualWall, NeverGivesAMillijouleWithTheLocalModel) {
  for (const Mode mode : {Mode::touched, Mode::near}) {
    for (const Device& device : kDevices) {
      for (const double stiffness : {50.0, 200.0, 800.0, 3200.0, 10000.0}) {
        const Result result = worst({device, {}, {}, stiffness, mode, 0});
        EXPECT_TRUE(result.passive()) << device.name << ' ' << stiffness << " N/m: " << result.lowest_energy << " J";
      }
    }
  }
}

TEST(VirtualWall, IsTheSameInEveryRun) {
  const Trial trial{kDevices[2], kHands[1], {}, 1500, Mode::touched, 3};
  const Result first = run(trial), second = run(trial);
  EXPECT_EQ(first.lowest_energy, second.lowest_energy);
  EXPECT_EQ(first.ripple, second.ripple);
  EXPECT_EQ(first.rendered, second.rendered);
  Trial other = trial;
  other.seed = 4;
  EXPECT_NE(run(other).lowest_energy, first.lowest_energy);
}

}  // namespace
}  // namespace softhand::wall
