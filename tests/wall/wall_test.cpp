// A wall that is felt through the local model, with the delay, jitter and loss of a real rig.
#include <gtest/gtest.h>

#include "wall/virtual_wall.hpp"

namespace softhand::wall {
namespace {

TEST(VirtualWall, IsStableAndPassiveAtFiveTimesTheStiffness) {
  for (const Device& device : kDevices) {
    const double held = largest_stiffness(device, {}, Mode::held, false);
    EXPECT_GT(held, 0) << device.name;
    const Result five = worst({device, {}, {}, 5 * held, Mode::local, 0});
    EXPECT_TRUE(five.passive()) << device.name << ": " << 5 * held << " N/m, " << five.lowest_energy << " J";
    // Five times is more than a Touch renders at all.
    if (5 * held > device.stiffness) continue;
    EXPECT_TRUE(five.stable()) << device.name << ": " << 5 * held << " N/m, " << five.ripple << " m";
    EXPECT_NEAR(five.rendered, 5 * held, 0.02 * 5 * held) << device.name;
  }
}

TEST(VirtualWall, HeldForcesGiveEnergyAtAnyStiffness) {
  // The test of passivity can fail: the device of today is not passive even where it is stable.
  for (const Device& device : kDevices) EXPECT_FALSE(worst({device, {}, {}, 50, Mode::held, 0}).passive());
}

TEST(VirtualWall, NeverGivesAMillijouleWithTheLocalModel) {
  for (const Device& device : kDevices) {
    for (const double stiffness : {50.0, 200.0, 800.0, 3200.0, 10000.0}) {
      const Result result = worst({device, {}, {}, stiffness, Mode::local, 0});
      EXPECT_TRUE(result.passive()) << device.name << ' ' << stiffness << " N/m: " << result.lowest_energy << " J";
    }
  }
}

TEST(VirtualWall, IsTheSameInEveryRun) {
  const Trial trial{kDevices[2], kHands[1], {}, 1500, Mode::local, 3};
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
