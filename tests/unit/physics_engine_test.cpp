// The world's requirements on a physics engine, tested without the world: resting bodies sleep, and they wake in time.
#include "world/physics_engine.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>
#include <random>

#include "math/rotation.hpp"
#include "support/shapes.hpp"
#include "world/solid.hpp"

namespace softhand::physics_engine_test {
namespace {

/// Slot 0 is a table, slot 1 a box on the table, slot 2 a second box on the first. Half of a box's edge is 20 mm, its
/// mass is 0.1 kg.
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
    engine->add(slot, {testing::cube_shape(0.02),
                       0.1,
                       Vector3::Constant(0.1 * 0.04 * 0.04 / 6),
                       0.8,
                       {position, Quaternion::Identity()}});
    engine->set_gravity(slot, its_gravity);
  }
  void run(double seconds) {
    for (int i = 0; i < std::lround(seconds / kStep); ++i) engine->step(kStep);
  }
};

TEST(PhysicsEngineSleep, RestingBodiesSleepAndWakeInTheStepThatPushesThem) {
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
  EXPECT_FALSE(world.engine->asleep(2)) << "this box stands on the pushed one";
}

TEST(PhysicsEngineSleep, SleepingBodyFallsWithoutSupportAndWakesWhenHit) {
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

TEST(PhysicsEngineSleep, CreepOfATenthOfAMillimetrePerSecondContinues) {
  Sleepers world;
  world.add_box(3, {0.2, 0.2, 0}, Vector3::Zero());
  world.engine->place(3, {Vector3(0.2, 0.2, 0), Quaternion::Identity()}, {Vector3(0, 0, 1e-4), Vector3::Zero()});
  world.run(10);
  ASSERT_TRUE(world.engine->asleep(1)) << "no body sleeps: this test shows nothing";
  EXPECT_FALSE(world.engine->asleep(3));
  EXPECT_NEAR(world.engine->pose(3).position.z(), 1e-3, 1e-5);
}

// The first direction is one that Bullet once gave for a cube tipping on a table. By this direction the cube was 216 mm
// deep in the table.
TEST(SeparatingPlane, CorrectsAWrongDirection) {
  const Shape table = testing::box_shape({0.4, 0.02, 0.4}), cube = testing::cube_shape(0.02);
  const Pose pose{{0, 0.02 + 0.02 * std::sqrt(2.0), 0},
                  Quaternion(Eigen::AngleAxisd(0.25 * std::numbers::pi, Vector3::UnitZ()))};
  for (const Vector3& direction : {Vector3(0.4574, 0.8875, 0.0561), Vector3(1, 0, 0), Vector3(0, -1, 0)}) {
    const SeparatingPlane plane = separating_plane(cube, pose, table, Pose{}, direction.normalized());
    EXPECT_NEAR(plane.gap, 0, 1e-12);
    EXPECT_NEAR(plane.normal.y(), 1, 1e-12);
  }
}

// The objects nearly touch, in poses of objects that lie, stand and tip. The gap of the returned plane may be only
// slightly smaller than the gap of the known plane.
TEST(SeparatingPlane, SeparatesAsWellAsAKnownPlaneInThousandsOfPoses) {
  std::mt19937_64 generator(1);
  const auto uniform = [&generator] { return 2.0 * static_cast<double>(generator() >> 11) * 0x1p-53 - 1.0; };
  const auto vector = [&uniform](double scale) {
    const double x = uniform(), y = uniform(), z = uniform();
    return Vector3(scale * Vector3(x, y, z));
  };
  Shape hull;
  hull.kind = static_cast<std::uint32_t>(ShapeKind::convex_hull);
  for (int i = 0; i < 40; ++i) {
    const Vector3 v = 0.02 * vector(1).normalized();
    hull.vertices.push_back({v.x(), v.y(), v.z()});
  }
  Shape cylinder;
  cylinder.kind = static_cast<std::uint32_t>(ShapeKind::cylinder);
  cylinder.size = {0.02, 0.03, 0};
  const Shape table = testing::box_shape({0.4, 0.02, 0.4}), plate = testing::box_shape({0.03, 0.001, 0.02}),
              cube = testing::cube_shape(0.02);
  double worst = 0;
  for (const Shape& neighbour : {table, cylinder, cube}) {
    for (const Shape& object : {cube, plate, cylinder, hull}) {
      const auto engine = make_physics_engine("bullet");
      for (int i = 0; i < 3000; ++i) {
        const Vector3 normal = i % 2 == 0 ? Vector3::UnitY() : Vector3(vector(1).normalized());
        const double gap = (i % 4 < 2 ? 1 : -1) * std::pow(10.0, -8 + 5 * std::abs(uniform()));  // m
        Pose pose;
        pose.orientation = rotation_exp(vector(i % 3 == 0 ? 1e-3 : i % 3 == 1 ? 0.3 : 3));
        pose.position = support(neighbour, Pose{}, normal) + gap * normal - support(object, pose, -normal);
        engine->add(0, {neighbour, 0, Vector3::Zero(), 0.5, Pose{}});
        engine->add(1, {object, 0.05, Vector3::Constant(1e-5), 0.5, pose});
        Vector3 direction;
        ASSERT_TRUE(engine->closest_direction(1, 0, 0.05, direction));
        worst = std::max(worst, gap - separating_plane(object, pose, neighbour, Pose{}, direction).gap);
        engine->remove(1);
        engine->remove(0);
      }
    }
  }
  EXPECT_LE(worst, 0.6e-3) << "found for two cylinders rim to rim; 20 mm with the engine's direction alone";
}

}  // namespace
}  // namespace softhand::physics_engine_test
