// What the world asks of a physics engine, without the world: who rests sleeps, and wakes in time.
#include "world/physics_engine.hpp"
#include "support/shapes.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>

namespace softhand {
namespace {

/// Slot 0 a table, 1 a box that stands on it, 2 a second box on the first; half of the edge 20 mm, 0.1 kg.
struct Sleepers {
  static constexpr double kStep = 1.0 / 250;
  std::unique_ptr<PhysicsEngine> engine = make_physics_engine("bullet");
  const Vector3 gravity{0, -9.81, 0};

  Sleepers() {
    Shape slab;
    slab.kind = static_cast<std::uint32_t>(ShapeKind::box);
    slab.size = {0.5, 0.02, 0.5};
    engine->add(0, {slab, 0, Vector3::Zero(), 0.8, {Vector3(0, -0.02, 0), Quaternion::Identity()}});
    for (const std::size_t slot : {1u, 2u}) add_box(slot, {0, 0.02 + 0.04 * static_cast<double>(slot - 1), 0}, gravity);
  }
  void add_box(std::size_t slot, const Vector3& position, const Vector3& its_gravity) {
    engine->add(slot, {testing::cube_shape(0.02), 0.1, Vector3::Constant(0.1 * 0.04 * 0.04 / 6), 0.8, {position, Quaternion::Identity()}});
    engine->set_gravity(slot, its_gravity);
  }
  void run(double seconds) {
    for (int i = 0; i < std::lround(seconds / kStep); ++i) engine->step(kStep);
  }
};

TEST(PhysicsEngineSleep, WhatRestsIsLeftOutAndWokenInTheStepThatPushesIt) {
  Sleepers world;
  world.run(1);
  EXPECT_FALSE(world.engine->asleep(1));
  world.run(4);
  ASSERT_TRUE(world.engine->asleep(1));
  ASSERT_TRUE(world.engine->asleep(2));
  world.engine->apply(1, {Vector3(5, 0, 0), Vector3::Zero()});
  world.engine->step(Sleepers::kStep);
  EXPECT_GT(world.engine->velocity(1).linear.x(), 0.05) << "5 N on 0.1 kg, less friction, for 4 ms";
  EXPECT_FALSE(world.engine->asleep(1));
  EXPECT_FALSE(world.engine->asleep(2)) << "it stands on what was pushed";
}

TEST(PhysicsEngineSleep, ASleeperFallsWhenItsSupportGoesAndIsWokenByWhatHitsIt) {
  Sleepers world;
  world.run(5);
  ASSERT_TRUE(world.engine->asleep(1));
  ASSERT_TRUE(world.engine->asleep(2));
  world.engine->remove(1);
  world.run(0.05);
  EXPECT_LT(world.engine->velocity(2).linear.y(), -0.4);
  world.run(5);
  ASSERT_TRUE(world.engine->asleep(2));
  EXPECT_NEAR(world.engine->pose(2).position.y(), 0.02, 2e-4);
  world.add_box(1, {0, 0.3, 0}, world.gravity);
  world.run(5);
  ASSERT_TRUE(world.engine->asleep(2));
  world.engine->place(1, {Vector3(-0.1, 0.021, 0), Quaternion::Identity()}, {Vector3(2, 0, 0), Vector3::Zero()});
  world.run(0.2);
  EXPECT_GT(world.engine->pose(2).position.x(), 0.005);
}

TEST(PhysicsEngineSleep, ACreepOfATenthOfAMillimetreASecondGoesOn) {
  Sleepers world;
  world.add_box(3, {0.2, 0.2, 0}, Vector3::Zero());
  world.engine->place(3, {Vector3(0.2, 0.2, 0), Quaternion::Identity()}, {Vector3(0, 0, 1e-4), Vector3::Zero()});
  world.run(10);
  ASSERT_TRUE(world.engine->asleep(1)) << "nothing sleeps at all: this shows nothing";
  EXPECT_FALSE(world.engine->asleep(3));
  EXPECT_NEAR(world.engine->pose(3).position.z(), 1e-3, 1e-5);
}

}  // namespace
}  // namespace softhand
