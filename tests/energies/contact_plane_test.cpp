// A mirrored object on the world's planes: derivatives, rest depth, the block on the slope, rolling.
#include <gtest/gtest.h>

#include <cfenv>
#include <cmath>

#include "energies/dense_step.hpp"
#include "energies/derivative_suite.hpp"
#include "energies/inertia.hpp"
#include "energies/memory_suite.hpp"
#include "energies/plane_contact.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand::contact_plane_test {
namespace {

constexpr double kGravity = 9.81;

Shape make(ShapeKind kind, Vec3 size) {
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(kind);
  shape.size = size;
  return shape;
}

NeighbourPlane table(double mu, const Vector3& normal = Vector3::UnitY()) {
  NeighbourPlane plane;
  plane.neighbour = 9;
  plane.normal = to_wire(normal);
  plane.friction = mu;
  return plane;
}

struct Body {
  Body(const Shape& given, double mass_, const Vector3& gravity, const NeighbourPlane& plane)
      : shape(given), mass(mass_), inertia({1e-3}, 1), planes({1, 1}, 0, 1) {
    state.node_positions = Eigen::Matrix3Xd::Constant(3, 1, 10.0);
    state.node_velocities = Eigen::Matrix3Xd::Zero(3, 1);
    state.body_poses.resize(1);
    state.body_velocities.resize(1);
    inertia.set_dynamic(0, mass, mass / shape.solid().volume * shape.solid().inertia, gravity);
    planes.set_object(0, &shape, mass, mass * gravity.norm());
    planes.set_planes(0, {&plane, 1});
  }
  void run(int steps, double dt, double tolerance = 1e-13) {
    testing::DenseStepper stepper({&inertia, &planes}, state);
    for (int i = 0; i < steps; ++i) stepper.step(state, dt, tolerance);
  }
  Vector3 position() const { return state.body_poses[0].position; }
  ShapeGeometry shape;
  double mass;
  Inertia inertia;
  PlaneContact planes;
  State state;
};

const Shape kCube = make(ShapeKind::box, {0.02, 0.02, 0.02});

TEST(PlaneContact, Derivatives) {
  for (const Shape& shape :
       {kCube, make(ShapeKind::cylinder, {0.02, 0.03, 0}), make(ShapeKind::capsule, {0.015, 0.02, 0})}) {
    for (std::uint64_t seed = 1; seed <= 4; ++seed) {
      Body body(shape, 0.05, Vector3(0, -kGravity, 0), table(0.6, Vector3(0.1, 1, -0.2).normalized()));
      body.state.body_poses[0].orientation = testing::random_state(body.state.layout(), seed).body_poses[0].orientation;
      body.state.body_poses[0].position = Vector3(0, 0.02, 0);
      body.state.body_velocities[0] = {Vector3(0.1, -0.1, 0.2), Vector3(1, 2, -1)};
      body.run(2, 0.004);
      // After the first contact the body still presses and slides.
      const State moved = testing::perturbed(body.state, seed, 3e-4, 3e-3);
      testing::check_term(body.planes, body.state, 0.004, moved, {.step = 1e-7, .tolerance = 1e-4});
    }
  }
}

TEST(PlaneContact, RestDepthFollowsFromTheStiffnessPerPlane) {
  // 50 g give k_A = max(10 kN/m, 5.49 N/0.5 mm) = 10.98 kN/m for all four corners together.
  Body body(kCube, 0.05, Vector3(0, -kGravity, 0), table(0.5));
  body.state.body_poses[0].position.y() = 0.03;
  body.run(400, 1.0 / 90);
  const double stiffness = (0.05 * kGravity + 5) / 0.5e-3;
  EXPECT_NEAR(body.position().y(), 0.02 - 0.05 * kGravity / stiffness, 1e-8);
  EXPECT_EQ(body.planes.count(0), 4);
  EXPECT_NEAR(body.planes.wrench(0).force.y(), 0.05 * kGravity, 1e-6);
  EXPECT_LE(body.planes.wrench(0).torque.norm(), 1e-8);
}

TEST(PlaneContact, BlockOnASlopeSticksWithoutCreep) {
  const double angle = std::atan(0.45);
  Body body(kCube, 0.05, kGravity * Vector3(std::sin(angle), -std::cos(angle), 0), table(0.5));
  body.state.body_poses[0].position.y() = 0.02;
  body.run(1200, 1.0 / 90);
  const Vector3 start = body.position();
  body.run(900, 1.0 / 90);
  EXPECT_LE((body.position() - start).norm() / 10.0, 1e-9);
}

TEST(PlaneContact, BlockOnASlopeSlides) {
  const double angle = std::atan(0.5);
  Body body(make(ShapeKind::box, {0.04, 0.005, 0.04}), 0.05, kGravity * Vector3(std::sin(angle), -std::cos(angle), 0),
            table(0.49));
  body.state.body_poses[0].position.y() = 0.005;
  body.run(180, 1.0 / 90);
  const double before = body.state.body_velocities[0].linear.x();
  body.run(90, 1.0 / 90);
  EXPECT_NEAR(body.state.body_velocities[0].linear.x() - before, 0.087734, 0.01 * 0.087734);
}

// A solid ball rolls with an acceleration of 5/7 g sin(angle), a cylinder with 2/3 g sin(angle).
TEST(PlaneContact, RollsWithTheKnownAcceleration) {
  const double angle = 0.2;
  for (const auto& [shape, share] : {std::pair{make(ShapeKind::sphere, {0.02, 0, 0}), 5.0 / 7},
                                     std::pair{make(ShapeKind::cylinder, {0.02, 0.03, 0}), 2.0 / 3}}) {
    Body body(shape, 0.1, kGravity * Vector3(std::sin(angle), -std::cos(angle), 0), table(0.8));
    body.state.body_poses[0] = {Vector3(0, 0.02, 0),
                                rotation_exp(Vector3(M_PI / 2, 0, 0))};  // the cylinder's axis along z
    body.run(100, 1.0 / 200);
    const double before = body.state.body_velocities[0].linear.x();
    body.run(100, 1.0 / 200);
    EXPECT_NEAR((body.state.body_velocities[0].linear.x() - before) / 0.5, share * kGravity * std::sin(angle),
                0.02 * kGravity * std::sin(angle));
    EXPECT_NEAR(body.state.body_velocities[0].angular.z(), -body.state.body_velocities[0].linear.x() / 0.02,
                0.05 * body.state.body_velocities[0].linear.x() / 0.02);
  }
}

TEST(PlaneContact, DampingDoesNotPull) {
  Body body(kCube, 0.05, Vector3::Zero(), table(0.5));
  body.state.body_poses[0].position.y() = 0.02 - 1e-4;
  body.state.body_velocities[0].linear.y() = 1.0;
  body.run(1, 1.0 / 90);
  EXPECT_GE(body.planes.wrench(0).force.y(), 0);
  EXPECT_NEAR(body.state.body_velocities[0].linear.y(), 1.0, 1e-9);
}

// For example a mug that the hand stops above a table.
TEST(PlaneContact, APointThatStopsAboveThePlaneIsNotPulled) {
  Body body(kCube, 0.3, Vector3(0, -kGravity, 0), table(0.5));
  body.state.body_poses[0].position.y() = 0.024;
  body.state.body_velocities[0].linear.y() = -0.5;
  State stopped = body.state, landed = body.state;
  stopped.body_poses[0].position.y() = 0.022;
  landed.body_poses[0].position.y() = 0.0199;
  testing::bound_matrix(body.planes, body.state);
  body.planes.begin_step(body.state, 1.0 / 90);
  EXPECT_GT(body.planes.value(stopped), 0) << "J, predicted to land";
  EXPECT_TRUE(body.planes.revise(stopped));
  EXPECT_EQ(body.planes.value(stopped), 0);
  EXPECT_GT(body.planes.value(landed), 0) << "J, it may still land in this step";
  EXPECT_FALSE(body.planes.revise(stopped));
  body.planes.begin_step(body.state, 1.0 / 90);
  EXPECT_FALSE(body.planes.revise(landed));
}

// First the plane carries the object sideways like a conveyor belt. Then it lifts the object like a rising floor.
TEST(PlaneContact, ObjectFollowsAMovingPlane) {
  Body body(kCube, 0.05, Vector3(0, -kGravity, 0), table(0.8));
  body.state.body_poses[0].position.y() = 0.02;
  body.run(100, 1.0 / 90);
  NeighbourPlane belt = table(0.8);
  belt.velocity = {0.3, 0, 0};
  body.planes.set_planes(0, {&belt, 1});
  body.run(90, 1.0 / 90);
  EXPECT_NEAR(body.state.body_velocities[0].linear.x(), 0.3, 1e-3);
  NeighbourPlane lift = table(0.8);
  lift.velocity = {0, 0.1, 0};
  body.planes.set_planes(0, {&lift, 1});
  body.run(90, 1.0 / 90);
  EXPECT_NEAR(body.state.body_velocities[0].linear.y(), 0.1, 1e-3);
  EXPECT_NEAR(body.position().y(), 0.12, 1e-3);
}

TEST(PlaneContact, RepeatedPlanesKeepTheirGrip) {
  const double angle = std::atan(0.45);
  const NeighbourPlane slope = table(0.5);
  Body body(kCube, 0.05, kGravity * Vector3(std::sin(angle), -std::cos(angle), 0), slope);
  body.state.body_poses[0].position.y() = 0.02;
  body.run(1200, 1.0 / 90);
  const Vector3 start = body.position();
  for (int i = 0; i < 300; ++i) {
    body.planes.set_planes(0, {&slope, 1});
    body.run(1, 1.0 / 90);
  }
  EXPECT_LE((body.position() - start).norm(), 1e-9);
}

TEST(PlaneContact, MemoryRepeatsTheBits) {
  NeighbourPlane plane = table(0.3, Vector3(0.1, 1, 0).normalized());
  plane.velocity = {0.2, 0.05, -0.1};
  Body body(kCube, 0.05, Vector3(0, -kGravity, 0), plane);
  body.state.body_poses[0].position.y() = 0.021;
  body.state.body_velocities[0] = {Vector3(0.3, -0.2, 0.1), Vector3(1, 2, -1)};
  body.run(5, 1.0 / 90);
  ASSERT_GT(body.planes.count(0), 0);
  testing::check_memory(body.planes, body.state, [&](State&) { body.run(1, 1.0 / 90); });
  PlaneContact empty({1, 1}, 0, 1);
  EXPECT_THROW(empty.load(body.planes.save()), std::invalid_argument);
}

TEST(PlaneContact, ACompliantNeighbourWithoutStiffnessPushesNothing) {
  NeighbourPlane plane = table(0.6);
  plane.kind = kNeighbourCompliant;
  plane.stiffness = 0;
  Body body(kCube, 0.05, Vector3::Zero(), plane);
  body.state.body_poses[0].position = Vector3(0, 0.019, 0);
  std::feclearexcept(FE_INVALID);
  body.planes.begin_step(body.state, 0.004);
  EXPECT_FALSE(std::fetestexcept(FE_INVALID)) << "0/0";
  EXPECT_EQ(body.planes.value(body.state), 0);
  body.run(3, 0.004);
  EXPECT_EQ(body.position(), Vector3(0, 0.019, 0));
}

TEST(PlaneContact, ClearedObjectIsFree) {
  Body body(kCube, 0.05, Vector3(0, -kGravity, 0), table(0.5));
  body.state.body_poses[0].position.y() = 0.02;
  body.run(50, 1.0 / 90);
  body.planes.clear_object(0);
  body.run(10, 0.01);
  EXPECT_NEAR(body.state.body_velocities[0].linear.y(), -0.1 * kGravity, 1e-6);
}

}  // namespace
}  // namespace softhand::contact_plane_test
