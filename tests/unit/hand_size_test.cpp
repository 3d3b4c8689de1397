// The choice of a hand's size for a machine, with invented step times.
#include "hand/hand_size.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "hand/work_price.hpp"
#include "scene_file.hpp"
#include "support/block_hand.hpp"

namespace softhand::hand_size_test {
namespace {

HandSizeChoice choose(const std::vector<double>& fast_steps, double budget, std::size_t* measured = nullptr,
                      bool has_flexible_objects = false) {
  std::size_t asked = 0;
  const double least = least_fast_steps(has_flexible_objects);
  const HandSizeChoice choice = choose_hand_size(fast_steps.size(), budget, least, [&](std::size_t size) {
    EXPECT_EQ(size, asked++) << "each size is measured once, from coarse to fine";
    return fast_steps[size];
  });
  if (measured != nullptr) *measured = asked;
  return choice;
}

TEST(HandSize, ChoosesTheFinestSizeWithABudgetOfTwoFastSteps) {
  const std::vector<double> steps{0.5e-3, 1e-3, 3e-3, 12e-3, 50e-3};
  const double period = 1.0 / 90;
  EXPECT_EQ(choose(steps, 0.7 * period).size, 2u);
  EXPECT_NEAR(choose(steps, 0.7 * period).budget_fast_steps, 0.7 * period / 3e-3, 1e-12);
  EXPECT_EQ(choose(steps, 6e-3).size, 2u) << "exactly two fast steps fit";
  EXPECT_EQ(choose(steps, 5.9e-3).size, 1u);
  EXPECT_EQ(choose(steps, 1).size, 4u);
}

// A live hand with flexible objects never takes a smaller budget. With two fast steps it would always be late.
TEST(HandSize, ChoosesABudgetOfFourFastStepsWithFlexibleObjects) {
  const std::vector<double> steps{0.5e-3, 1e-3, 3e-3};
  EXPECT_EQ(choose(steps, 12e-3, nullptr, true).size, 2u) << "exactly four fast steps fit";
  EXPECT_EQ(choose(steps, 11.9e-3, nullptr, true).size, 1u);
  EXPECT_EQ(choose(steps, 11.9e-3).size, 2u);
  EXPECT_GE(least_fast_steps(true), WorkPrice::least_budget(true));
  EXPECT_GE(least_fast_steps(false), WorkPrice::least_budget(false));
}

TEST(HandSize, StopsAtTheFirstSizeThatIsTooFine) {
  std::size_t measured = 0;
  const HandSizeChoice choice = choose({1e-3, 5e-3, 1e-3}, 7e-3, &measured);
  EXPECT_EQ(choice.size, 0u);
  EXPECT_EQ(measured, 2u);
  EXPECT_EQ(choice.fast_steps.size(), 2u);
}

TEST(HandSize, ChoosesTheCoarsestSizeOnASlowMachine) {
  std::size_t measured = 0;
  const HandSizeChoice choice = choose({9e-3, 20e-3}, 7e-3, &measured);
  EXPECT_EQ(choice.size, 0u);
  EXPECT_EQ(measured, 1u);
  EXPECT_NEAR(choice.budget_fast_steps, 7.0 / 9, 1e-12);
}

// Each reading of this clock is a tick after the previous one. Every fifth reading may be late, by 100 ms.
TEST(HandSize, MeasuresTheMedianPriceOfWorkOnTheGivenClock) {
  // Contact of the coarsest block costs many of its cheap fast steps, and how many depends on the last digits.
  const HandModel hand = testing::block_hand(2);
  int clock_reads = 0;
  double time = 0, tick = 1e-3, late = 0.1;
  const auto clock = [&] { return time += ++clock_reads % 5 == 0 ? late : tick; };
  const double fast_step = measure_fast_step({hand}, {}, {}, 1, clock);
  // A step with a budget of two fast steps takes one tick here, and a live step is priced twice as dear.
  EXPECT_GT(fast_step, 1.5 * tick / 4);
  EXPECT_LT(fast_step, 1.5 * tick);
  EXPECT_GE(clock_reads, 18);
  clock_reads = 0;
  late = tick;
  EXPECT_NEAR(measure_fast_step({hand}, {}, {}, 1, clock), fast_step, 0.2 * fast_step) << "late readings hardly count";
  clock_reads = 0;
  tick = late = 2e-3;
  EXPECT_NEAR(measure_fast_step({hand}, {}, {}, 1, clock), 2 * fast_step, 0.4 * fast_step);
  clock_reads = 0;
  measure_fast_step({hand}, {}, {}, 1e-4, clock);
  EXPECT_LT(clock_reads, 14) << "measuring stops early if the first steps are too slow";
}

TEST(WorkPrice, NineOfTenStepsCostAtMostThePrice) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> cost(1e-3, 3e-3);  // s per fast step
  WorkPrice price(1e-3, 8e-3, WorkPrice::least_budget(false));
  EXPECT_NEAR(price.budget(), 8, 1e-12);
  int within = 0, count = 0;
  for (int step = 0; step < 20'000; ++step) {
    const double seconds = cost(random) * price.budget();
    if (step >= 2000) within += seconds <= price.fast_step() * price.budget(), ++count;
    price.learn(seconds, price.budget());
  }
  EXPECT_NEAR(static_cast<double>(within) / count, 0.9, 0.02);
  EXPECT_NEAR(price.fast_step(), 2.8e-3, 0.2e-3);
}

TEST(WorkPrice, FollowsASlowMachineWithinAThirdOfASecond) {
  WorkPrice price(1e-3, 6.7e-3, WorkPrice::least_budget(false));
  int steps = 0;
  for (; price.fast_step() < 1.5e-3; ++steps) price.learn(1.6e-3 * price.budget(), price.budget());
  EXPECT_LT(steps, 90 / 3);
}

TEST(WorkPrice, ASingleLongPauseHardlyChangesIt) {
  WorkPrice price(1e-3, 6.7e-3, WorkPrice::least_budget(false));
  price.learn(2, price.budget());
  EXPECT_LT(price.fast_step(), 1.02e-3);
}

TEST(WorkPrice, SmallStepsTeachNothing) {
  WorkPrice price(1e-3, 6.7e-3, WorkPrice::least_budget(false));
  for (int step = 0; step < 100; ++step) price.learn(1e-2, 0.4 * price.budget());
  EXPECT_EQ(price.fast_step(), 1e-3);
}

TEST(WorkPrice, KeepsALargerBudgetWithFlexibleObjects) {
  const double least = WorkPrice::least_budget(true);
  EXPECT_GT(least, 2 * WorkPrice::least_budget(false));
  WorkPrice price(1, 6.7e-3, least);
  EXPECT_NEAR(price.budget(), least, 1e-12);
}

TEST(WorkPrice, KeepsABudgetWithWhichAStepCanReuseAFactor) {
  WorkPrice price(1, 6.7e-3, WorkPrice::least_budget(false));
  EXPECT_NEAR(price.budget(), 1.5, 1e-12);
  for (int step = 0; step < 1000; ++step) price.learn(1, price.budget());
  EXPECT_NEAR(price.budget(), 1.5, 1e-12);
  for (int step = 0; step < 1000; ++step) price.learn(1e-3, price.budget());
  EXPECT_GT(price.budget(), 4);
}

std::string scene_path(const char* name) { return std::string(SOFTHAND_SOURCE_DIR) + "/config/scenes/" + name; }

// Processes other than the hand's use only joints and bones. They must not depend on the size that the hand chose.
TEST(HandSize, AllShippedSizesHaveTheSameSkeleton) {
  const Scene scene = read_scene(scene_path("pinch.toml"));
  ASSERT_TRUE(chooses_hand_size(scene));
  const HandModel stand_in = load_scene_hand(scene);
  const std::vector<HandModel> hands = load_possible_hands(scene);
  ASSERT_EQ(hands.size(), kHandSizes.size());
  int nodes = 0;
  for (const HandModel& hand : hands) {
    EXPECT_GT(hand.node_count(), nodes) << "coarsest first";
    nodes = hand.node_count();
    EXPECT_EQ(hand.side, stand_in.side);
    EXPECT_EQ(hand.joint_radii, stand_in.joint_radii);
    for (std::size_t j = 0; j < kJointCount; ++j) {
      EXPECT_EQ(hand.rest_joints[j].position, stand_in.rest_joints[j].position);
      EXPECT_EQ(hand.rest_joints[j].orientation.coeffs(), stand_in.rest_joints[j].orientation.coeffs());
    }
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const BodyModel &one = hand.bodies[b], &other = stand_in.bodies[b];
      EXPECT_EQ(one.mass, other.mass);
      EXPECT_EQ(one.inertia, other.inertia);
      EXPECT_EQ(one.joint_from_body.position, other.joint_from_body.position);
      EXPECT_EQ(one.joint.flexion_range, other.joint.flexion_range);
      EXPECT_EQ(one.joint.abduction_range, other.joint.abduction_range);
      EXPECT_EQ(one.coupling_linear_stiffness, other.coupling_linear_stiffness);
      EXPECT_EQ(one.coupling_angular_stiffness, other.coupling_angular_stiffness);
      EXPECT_EQ(one.coupling_force_cap, other.coupling_force_cap);
    }
  }
}

TEST(HandSize, LoadsTheStandInHandIfTheSizeIsChosenAtStart) {
  EXPECT_EQ(load_scene_hand(read_scene(scene_path("pinch.toml"))).name, "right_1450");
  const Scene fixed = read_scene(scene_path("pinch.toml"), {"hand.model=right_750.hand.json"});
  EXPECT_FALSE(chooses_hand_size(fixed));
  ASSERT_EQ(load_possible_hands(fixed).size(), 1u);
  EXPECT_EQ(load_possible_hands(fixed)[0].name, "right_750");
}

}  // namespace
}  // namespace softhand::hand_size_test
