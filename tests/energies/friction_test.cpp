// Friction of the skin on objects (eq. 33): known results, no creep, and its first iteration.
#include <gtest/gtest.h>

#include <cmath>

#include "contact/coulomb.hpp"
#include "energies/contact_rig.hpp"
#include "math/rotation.hpp"

namespace softhand::friction_test {
namespace {

using testing::ContactRig;
using testing::kGravity;
using testing::NodesOnPlane;
using testing::shape_of;

TEST(CoulombSpring, EnergyForceAndStiffnessAreConsistent) {
  const CoulombSpring spring{800, 0.4};
  const Vector3 n = Vector3(1, 2, 3).normalized();
  for (const double length : {1e-4, 4.9e-4, 5.1e-4, 3e-3}) {
    const Vector3 s = length * Vector3(n.unitOrthogonal());
    const double h = 1e-8;
    EXPECT_NEAR((spring.energy(length + h) - spring.energy(length - h)) / (2 * h), spring.secant(length) * length,
                1e-6);
    const Vector3 across = n.cross(s).normalized();
    for (const Vector3& d : {Vector3(s.normalized()), across}) {
      const auto force = [&](double t) { return Vector3(spring.secant((s + t * d).norm()) * (s + t * d)); };
      EXPECT_LE(((force(h) - force(-h)) / (2 * h) - spring.tangent(s, n) * d).norm(), 1e-4);
    }
    EXPECT_LE(spring.secant(length) * length, spring.bound + 1e-15);
  }
  EXPECT_EQ((CoulombSpring{800, 0}.tangent(Vector3::Zero(), n)), Matrix3::Zero());
}

TEST(Friction, SticksBelowTheAngleWithoutCreep) {
  NodesOnPlane scene(0.5);
  scene.gravity(std::atan(0.49));
  scene.run(1500, 1.0 / 90);  // settle
  const Vector3 start = scene.position();
  scene.run(90 * 10, 1.0 / 90);
  EXPECT_LE((scene.position() - start).norm() / 10.0, 1e-9) << "m/s of creep";
  EXPECT_GT(scene.rig.contacts.anchors().size(), 0u);
  EXPECT_FALSE(scene.rig.contacts.anchors()[0].sliding);
}

TEST(Friction, SlidesWithCoulombsAcceleration) {
  const double mu = 0.49, angle = std::atan(0.5);  // 26.565 degrees
  for (const double dt : {1.0 / 90, 1.0 / 240}) {
    NodesOnPlane scene(mu);
    scene.gravity(angle);
    scene.run(static_cast<int>(2.0 / dt), dt);
    const double before = scene.velocity().x();
    const int steps = static_cast<int>(1.0 / dt);
    scene.run(steps, dt);
    EXPECT_NEAR((scene.velocity().x() - before) / (steps * dt), 0.087734, 0.087734 * 1e-3);
    EXPECT_TRUE(scene.rig.contacts.anchors()[0].sliding);
    EXPECT_NEAR(scene.rig.contacts.anchors()[0].slip_speed, scene.velocity().x(), 1e-6);
  }
}

TEST(Friction, HeatIsTheLostEnergy) {
  NodesOnPlane scene(0.5);
  scene.gravity(0);
  scene.run(500, 1.0 / 90);
  scene.rig.state.node_velocities.row(0).setConstant(1.0);
  const double kinetic = 3 * 0.5 * 0.01;
  scene.run(3000, 1e-3, 1e-12);
  EXPECT_NEAR(scene.rig.contacts.dissipated(), kinetic, 0.02 * kinetic);
}

TEST(Friction, HandlesZeroAndHugeFriction) {
  NodesOnPlane slippery(0);
  slippery.gravity(0.1);
  slippery.run(90, 1.0 / 90);
  EXPECT_NEAR(slippery.velocity().x(), kGravity * std::sin(0.1), 1e-9);
  EXPECT_EQ(slippery.rig.contacts.count(), 3);

  NodesOnPlane rough(1000);
  rough.gravity(1.5);
  rough.run(2000, 1.0 / 90);
  EXPECT_LE(rough.velocity().norm(), 1e-9);
  EXPECT_EQ(rough.rig.contacts.count(), 3);
}

// A node is dragged around a fixed cylinder. Its anchor follows the surface. The anchor's normal follows the radius.
TEST(Friction, AnchorFollowsACurvedSurface) {
  const ShapeGeometry cylinder(shape_of(ShapeKind::cylinder, {0.02, 0.5, 0}));
  ContactRig rig(1, 1000, 1e-3);
  rig.contacts.set_object(0, &cylinder, 0.3, 1, ContactObject::fixed);
  rig.inertia.hold(0);
  for (int n = 0; n < 3; ++n) {
    rig.state.node_positions.col(n) = Vector3(0.0202, 0.01 * n, 0);
    rig.state.node_velocities.col(n) = Vector3(-0.05, 0, 0);
  }
  testing::DenseStepper stepper = rig.stepper();
  double angle = 0;
  for (int i = 0; i < 400; ++i) {
    const Vector3 p = rig.state.node_positions.col(0);
    const Vector3 radial = Vector3(p.x(), 0, p.z()).normalized();
    // The node is pressed on and pulled around, at up to about 0.4 m/s (5 degrees per step).
    const Vector3 around = Vector3::UnitY().cross(radial);
    rig.inertia.set_node_gravity(-300 * radial + 125 * std::min(1.0, i / 20.0) * around -
                                 150 * Vector3(rig.state.node_velocities.col(0)));
    stepper.step(rig.state, 1.0 / 240);
    ASSERT_EQ(rig.contacts.count(), 3);
    const auto& anchor = rig.contacts.anchors()[0];
    EXPECT_NEAR(std::hypot(anchor.anchor.x(), anchor.anchor.z()), 0.02, 1e-9);
    EXPECT_LE((anchor.normal - Vector3(anchor.anchor.x(), 0, anchor.anchor.z()) / 0.02).norm(), 2e-4);
    EXPECT_NEAR(std::hypot(rig.state.node_positions(0, 0), rig.state.node_positions(2, 0)), 0.0197, 5e-5)
        << "the node must not chatter";
    angle += 1.0 / 240 * around.dot(Vector3(rig.state.node_velocities.col(0))) / 0.02;
  }
  EXPECT_GT(angle, 3.0) << "the node did not slide around";
}

// A step of one iteration must not stick if the converged step slides.
TEST(Friction, OneIterationSlidesToo) {
  NodesOnPlane scene(0.49);
  scene.gravity(std::atan(0.5));
  for (int i = 0; i < 180; ++i) scene.step.step(scene.rig.state, 1.0 / 90, 1e-12, 1);
  const double before = scene.velocity().x();
  for (int i = 0; i < 90; ++i) scene.step.step(scene.rig.state, 1.0 / 90, 1e-12, 1);
  EXPECT_NEAR(scene.velocity().x() - before, 0.087734, 0.087734 * 0.02);
}

// A world's resting object has a velocity of some um/s. This must not change a step of one iteration in which a contact
// begins.
TEST(Friction, OneIterationIgnoresTheTinyVelocityOfARestingObject) {
  const auto after_touching = [](double speed) {
    NodesOnPlane scene(0.5, 500, 0.01, 1e-3);
    scene.rig.state.node_velocities.colwise() = Vector3(0.3, -0.2, 0);
    scene.rig.state.body_velocities[0].linear = Vector3(speed, speed, 0);
    scene.step.step(scene.rig.state, 1.0 / 90, 1e-12, 1);
    return scene.velocity();
  };
  const Vector3 resting = after_touching(0);
  ASSERT_GT(resting.y(), -0.19);
  ASSERT_LT(resting.x(), 0.299);
  EXPECT_LE((after_touching(1e-6) - resting).norm(), 1e-4);
}

}  // namespace
}  // namespace softhand::friction_test
