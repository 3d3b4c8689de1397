// Contact of points of the skin with objects (eq. 32): known results, no tunnelling, and what is published.
#include "energies/contact.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "energies/contact_rig.hpp"
#include "energies/memory_suite.hpp"
#include "math/rotation.hpp"
#include "support/contact_message.hpp"

namespace softhand::contact_test {
namespace {

using testing::ContactRig;
using testing::kGravity;
using testing::NodesOnPlane;
using testing::shape_of;

TEST(Contact, RestDepthIsWeightOverStiffness) {
  NodesOnPlane scene(0.5, 500, 0.01, 0.002);
  scene.gravity(0);
  scene.run(2000, 1.0 / 90);
  EXPECT_NEAR(scene.position().y(), -0.01 * kGravity / 500, 1e-9);
  EXPECT_NEAR(scene.rig.contacts.wrench(0).force.y(), -3 * 0.01 * kGravity, 1e-6);
  EXPECT_NEAR(scene.rig.contacts.penetration_quantile(scene.rig.state, 1.0), 0.01 * kGravity / 500, 1e-9);
  EXPECT_EQ(scene.rig.contacts.count(), 3);
}

TEST(Collider, AnObjectThatBecomesFixedMovesByNothing) {
  const ShapeGeometry ball(shape_of(ShapeKind::sphere, {0.01, 0, 0}));
  const PointGroups no_points({}, [](std::int32_t) { return std::span<const std::int32_t>(); });
  Collider collider(0, 0, true);
  collider.set(ball, ContactObject::moving);
  State state;
  state.body_poses.resize(1);
  state.body_velocities.resize(1);
  collider.begin_step(state, 0.01, no_points);
  state.body_poses[0] = {Vector3(0.1, 0, 0), rotation_exp(Vector3(0, 0.2, 0))};
  collider.end_step(state);
  EXPECT_NEAR(collider.moved().norm(), 0.1, 1e-12);
  EXPECT_NEAR(collider.turned().norm(), 0.2, 1e-12);
  collider.set(ball, ContactObject::fixed);
  collider.begin_step(state, 0.01, no_points);
  collider.end_step(state);
  EXPECT_EQ(collider.moved().norm(), 0);
  EXPECT_EQ(collider.turned().norm(), 0);
}

TEST(Contact, ReleasesNodesThatMoveAway) {
  NodesOnPlane scene(1.0);
  scene.gravity(0);
  scene.run(200, 1.0 / 90);
  ASSERT_EQ(scene.rig.contacts.count(), 3);
  scene.rig.inertia.set_node_gravity(Vector3(0, 5, 0));
  scene.run(20, 1.0 / 90);
  EXPECT_EQ(scene.rig.contacts.count(), 0);
  EXPECT_GT(scene.position().y(), 0.05);
  EXPECT_EQ(scene.rig.contacts.wrench(0).force.norm(), 0);
}

// The plate is 0.5 mm thick. The nodes move at 5 m/s and 60 Hz (83 mm per step) from every start height. Each step has
// one Newton iteration, as in the fast mode.
TEST(Contact, NothingTunnelsThroughAThinPlate) {
  const ShapeGeometry plate(shape_of(ShapeKind::box, {0.5, 0.00025, 0.5}));
  for (const bool moving : {false, true}) {
    int through = 0;
    for (int trial = 0; trial < 1000; ++trial) {
      ContactRig rig(1, 500, 1e-3);
      rig.contacts.set_object(0, &plate, 0.5, 1, moving ? ContactObject::moving : ContactObject::fixed);
      if (moving) {
        rig.inertia.set_dynamic(0, 1000.0, 100.0 * Matrix3::Identity(), Vector3::Zero());
      } else {
        rig.inertia.hold(0);
      }
      rig.state.node_positions.row(1).setConstant(0.0003 + 0.25 * trial / 1000.0);
      rig.state.node_velocities.row(1).setConstant(-5);
      rig.state.node_velocities.row(0).setConstant(0.2);
      testing::DenseStepper stepper = rig.stepper();
      double lowest = 1;
      for (int i = 0; i < 8; ++i) {
        stepper.step(rig.state, 1.0 / 60, 1e-9, 1);
        lowest = std::min(lowest, rig.state.node_positions.row(1).minCoeff());
      }
      if (rig.state.node_positions(1, 0) < 0 && rig.contacts.count() == 0) ++through;
      EXPECT_GT(lowest, -0.02) << "the first step must already stop the nodes";
    }
    EXPECT_EQ(through, 0);
  }
}

// A node at rest that an iteration moves through the surface: velocities did not predict the contact.
TEST(Contact, ReviseFindsWhatAnIterationCrossed) {
  const ShapeGeometry plate(shape_of(ShapeKind::box, {0.5, 0.00025, 0.5}));
  ContactRig rig(1, 500, 1e-3);
  rig.contacts.set_object(0, &plate, 0.5, 1, ContactObject::fixed);
  rig.state.node_positions.row(1).setConstant(0.002);
  rig.contact.begin_step(rig.state, 0.01);
  EXPECT_EQ(rig.contacts.count(), 0);
  State moved = rig.state;
  moved.node_positions.row(1).setConstant(-0.003);
  EXPECT_TRUE(rig.contact.revise(moved));
  EXPECT_EQ(rig.contacts.count(), 3);
  EXPECT_NEAR(rig.contact.value(moved), 3 * 0.5 * 500 * 0.00325 * 0.00325, 1e-9);
  EXPECT_EQ(rig.contact.value(rig.state), 0) << "it only pushes";
  EXPECT_FALSE(rig.contact.revise(moved)) << "nothing new";
  // The step is repeated from its start, as after a failure. It has no effect.
  rig.contact.begin_step(rig.state, 0.01);
  EXPECT_EQ(rig.contacts.count(), 0);
}

// A node that was predicted to cross stays outside. Before the first iteration its anchor acts from both sides, and
// after it the anchor does not pull.
TEST(Contact, AFreshContactDoesNotPullAfterAnIteration) {
  const ShapeGeometry plate(shape_of(ShapeKind::box, {0.5, 0.00025, 0.5}));
  ContactRig rig(1, 500, 1e-3);
  rig.contacts.set_object(0, &plate, 0.5, 1, ContactObject::fixed);
  rig.state.node_positions.row(1).setConstant(0.002);
  rig.state.node_velocities.row(1).setConstant(-1);
  rig.state.node_velocities.row(0).setConstant(0.2);
  rig.contact.begin_step(rig.state, 0.01);
  ASSERT_EQ(rig.contacts.count(), 3);
  State moved = rig.state;
  moved.node_positions.row(1).setConstant(0.001);
  moved.node_positions.row(0).array() += 0.001;
  EXPECT_GT(rig.contact.value(moved), 0);
  EXPECT_TRUE(rig.contact.revise(moved));
  EXPECT_EQ(rig.contact.value(moved), 0);
  EXPECT_EQ(rig.friction.value(moved), 0);
  VectorX gradient = VectorX::Zero(rig.state.layout().dof_count());
  rig.contact.add_gradient(moved, gradient);
  rig.friction.add_gradient(moved, gradient);
  EXPECT_EQ(gradient.norm(), 0);
}

// An object that is moved past resting nodes between two steps still catches them.
TEST(Contact, KinematicPlateSweepsNodesAlong) {
  const ShapeGeometry plate(shape_of(ShapeKind::box, {0.5, 0.00025, 0.5}));
  ContactRig rig(1, 500, 1e-3);
  rig.contacts.set_object(0, &plate, 0.5, 1, ContactObject::fixed);
  rig.inertia.hold(0);
  testing::DenseStepper stepper = rig.stepper();
  rig.state.body_poses[0].position.y() = -0.1;
  for (int i = 0; i < 20; ++i) {
    stepper.step(rig.state, 1.0 / 60);
    rig.state.body_poses[0].position.y() += 1.0 / 60;  // 1 m/s, 17 mm a step
  }
  EXPECT_GT(rig.state.node_positions(1, 0), rig.state.body_poses[0].position.y() - 0.03);
  EXPECT_GT(rig.state.node_positions(1, 0), 0.15);
}

void drum_slides_under_nodes(bool within_step, const Vector3& velocity) {
  constexpr double kMass = 1e-3, kStiffness = 50, kRadius = 0.02, kFriction = 0.5, kTimeStep = 1.0 / 90,
                   kTurn = 100 * kTimeStep;
  const ShapeGeometry drum(shape_of(ShapeKind::cylinder, {kRadius, 0.5, 0}));
  ContactRig rig(1, kStiffness, kMass);
  rig.contacts.set_object(0, &drum, kFriction, 1, ContactObject::fixed);
  rig.inertia.hold(0);
  rig.inertia.set_node_gravity(Vector3(0, -kGravity, 0));
  const Quaternion lying(Eigen::AngleAxisd(M_PI / 2, Vector3::UnitX()));
  for (int n = 0; n < 3; ++n)
    rig.state.node_positions.col(n) = Vector3(0, kRadius - kMass * kGravity / kStiffness, 0.01 * n);
  rig.state.node_velocities.colwise() = velocity;
  testing::DenseStepper stepper = rig.stepper();
  SCOPED_TRACE(within_step ? "turns within the step" : "turns between the steps");
  SCOPED_TRACE(velocity.transpose());
  for (int i = 0; i < 3; ++i) {
    const Quaternion turned(Eigen::AngleAxisd(-i * kTurn, Vector3::UnitZ()));
    rig.state.body_poses[0] = {i * kTimeStep * velocity, turned * lying};
    rig.state.body_velocities[0] = {velocity, Vector3(0, 0, within_step ? -kTurn / kTimeStep : 0)};
    stepper.step(rig.state, kTimeStep);
    ASSERT_EQ(rig.contacts.count(), 3) << i;
    const Vector3 force = -rig.contacts.wrench(0).force;
    EXPECT_NEAR(force.y(), 3 * kMass * kGravity, 0.1 * 3 * kMass * kGravity) << i;
    if (i > 0) {
      EXPECT_NEAR(force.x(), kFriction * force.y(), 0.1 * force.y()) << i;
    }
  }
}

// A drum that turns by 64 degrees in a step, or between two steps, slides under the nodes that lie on it. The nodes
// keep their weight, and friction pulls with mu times the weight. This also holds if drum and nodes have a common
// velocity.
TEST(Contact, DrumSlidesUnderNodes) {
  drum_slides_under_nodes(false, Vector3::Zero());
  for (const Vector3& velocity : {Vector3(0, 0, 0), Vector3(0, 2, 0), Vector3(-1, -3, 2)}) {
    drum_slides_under_nodes(true, velocity);
  }
}

// The spin of a smooth drum changes nothing, whether nodes hit it in the step or are inside from the start.
TEST(Contact, SpinOfASmoothDrumHasNoEffect) {
  constexpr double kRadius = 0.02;
  const ShapeGeometry drum(shape_of(ShapeKind::cylinder, {kRadius, 0.5, 0}));
  const Quaternion lying(Eigen::AngleAxisd(M_PI / 2, Vector3::UnitX()));
  const auto heights = [&](double height, double spin) {
    ContactRig rig(1, 50, 1e-3);
    rig.contacts.set_object(0, &drum, 0, 1, ContactObject::fixed);
    rig.inertia.hold(0);
    for (int n = 0; n < 3; ++n) rig.state.node_positions.col(n) = Vector3(0, kRadius + height, 0.01 * n);
    rig.state.body_poses[0].orientation = lying;
    rig.state.body_velocities[0].angular.z() = spin;
    testing::DenseStepper stepper = rig.stepper();
    std::vector<double> result;
    for (int i = 0; i < 30; ++i) {
      // Gravity points to the axis. Otherwise nodes on top would fall off to one side.
      const Vector3 from_axis(rig.state.node_positions(0, 0), rig.state.node_positions(1, 0), 0);
      rig.inertia.set_node_gravity(-kGravity * from_axis.normalized());
      stepper.step(rig.state, 1.0 / 90);
      result.push_back(from_axis.norm());
    }
    return result;
  };
  for (const double height : {1e-3, -1e-3}) {
    const std::vector<double> resting = heights(height, 0);
    ASSERT_LT(*std::min_element(resting.begin(), resting.end()), kRadius);
    for (const double spin : {3.0, 30.0, -100.0}) {
      const std::vector<double> spinning = heights(height, spin);
      for (std::size_t i = 0; i < resting.size(); ++i) {
        EXPECT_NEAR(spinning[i], resting[i], 2e-5) << height << " m, " << spin << " rad/s, step " << i;
      }
    }
  }
}

// In the frame of a turning body, the path of a node is an arc. The arc's chord cuts the body.
TEST(Contact, SpinningBallBesideNodesDoesNotTouchThem) {
  for (const auto& [kind, motion] :
       {std::pair(ShapeKind::sphere, ContactObject::moving), std::pair(ShapeKind::capsule, ContactObject::moving),
        std::pair(ShapeKind::cylinder, ContactObject::moving), std::pair(ShapeKind::cylinder, ContactObject::fixed)}) {
    const ShapeGeometry round(shape_of(kind, {0.03, 0.03, 0}));
    for (const double speed : {10.0, 30.0, 100.0}) {
      for (const double gap : {1e-6, 1e-4, 1e-3}) {
        ContactRig rig(1, 700, 1e-4);
        rig.contacts.set_object(0, &round, 0.5, 1, motion);
        const Matrix3 inertia = 1e-5 * Matrix3::Identity();
        if (motion == ContactObject::moving) rig.inertia.set_dynamic(0, 0.05, inertia, Vector3::Zero());
        rig.state.body_velocities[0].angular = Vector3(0, speed, 0);
        for (int n = 0; n < 3; ++n)
          rig.state.node_positions.col(n) = (0.03 + gap) * Vector3(std::cos(2.0 * n), 0, std::sin(2.0 * n));
        testing::DenseStepper stepper = rig.stepper();
        for (int i = 0; i < 5; ++i) stepper.step(rig.state, 1.0 / 90);
        EXPECT_LE(rig.state.node_velocities.cwiseAbs().maxCoeff(), 1e-9)
            << "kind " << static_cast<int>(kind) << ", " << speed << " rad/s, gap " << gap;
        EXPECT_NEAR(rig.state.body_velocities[0].angular.y(), speed, 1e-6 * speed);
      }
    }
  }
}

// The blade of a fan or the corner of a box hits a node that is outside before and after the step.
TEST(Contact, TurningObjectHitsANodeInItsWay) {
  const ShapeGeometry blade(shape_of(ShapeKind::box, {0.05, 0.0005, 0.05})),
      cube(shape_of(ShapeKind::box, {0.03, 0.03, 0.03}));
  const auto touched = [](const ShapeGeometry& shape, const Vector3& spin, const Vector3& node) {
    ContactRig rig(1, 700, 1e-4);
    rig.contacts.set_object(0, &shape, 0.5, 1, ContactObject::moving);
    rig.inertia.set_dynamic(0, 0.5, 1e-3 * Matrix3::Identity(), Vector3::Zero());
    rig.state.body_velocities[0].angular = spin;
    for (int n = 0; n < 3; ++n) rig.state.node_positions.col(n) = node;
    testing::DenseStepper stepper = rig.stepper();
    stepper.step(rig.state, 1.0 / 90);
    return rig.state.node_velocities.colwise().norm().minCoeff() > 1e-3;
  };
  EXPECT_TRUE(touched(blade, Vector3(0, 0, 30), Vector3(0.04, 0.005, 0)));
  EXPECT_TRUE(touched(cube, Vector3(0, 0, 40), Vector3(0.0346, -0.02, 0)));
}

TEST(Contact, NodeThatStartsInsideComesOutAtOneMetrePerSecond) {
  const ShapeGeometry box(shape_of(ShapeKind::box, {0.04, 0.04, 0.04}));
  for (const double dt : {1.0 / 90, 1.0 / 1000}) {
    ContactRig rig(1, 2000, 1e-3);
    rig.contacts.set_object(0, &box, 0.5, 1, ContactObject::fixed);
    rig.inertia.hold(0);
    testing::DenseStepper stepper = rig.stepper();
    for (int n = 0; n < 3; ++n) rig.state.node_positions.col(n) = Vector3(0.001 * n, 0.0015 * n + 1e-4, 0);
    double fastest = 0;
    bool out = false;
    for (int i = 0; i < static_cast<int>(0.5 / dt) && !out; ++i) {
      stepper.step(rig.state, dt);
      fastest = std::max(fastest, rig.state.node_velocities.colwise().norm().maxCoeff());
      out = box.signed_distance(rig.state.node_positions.col(0)) > -1e-6;
    }
    EXPECT_TRUE(out);
    EXPECT_LE(fastest, 2.01);  // a node on an undamped spring whose other end moves at 1 m/s reaches twice this speed
    EXPECT_GT(fastest, 0.5);
  }
}

// Two nodes are nearest to opposite faces, 20 mm away. Before, each left by its own face. Had they been the skin of one
// finger, they would have pulled it apart. The third node, 37 mm below the top, knows the exit that is nearest for all.
TEST(Contact, NodesOfABoneThatStartInsideLeaveInOneDirection) {
  const ShapeGeometry box(shape_of(ShapeKind::box, {0.04, 0.04, 0.04}));
  ContactRig rig(1, 2000, 1e-3);
  rig.contacts.set_object(0, &box, 0.5, 1, ContactObject::fixed);
  rig.inertia.hold(0);
  testing::DenseStepper stepper = rig.stepper();
  const std::array<Vector3, 3> starts{Vector3(-0.02, 0, 0), Vector3(0.02, 0, 0), Vector3(0, 0.003, 0)};
  for (int n = 0; n < 3; ++n) rig.state.node_positions.col(n) = starts[static_cast<std::size_t>(n)];
  for (int i = 0; i < 20; ++i) stepper.step(rig.state, 1.0 / 90);
  for (int n = 0; n < 3; ++n) {
    const Vector3 end = rig.state.node_positions.col(n);
    EXPECT_GT(end.y(), 0.04 - 1e-6) << n;
    EXPECT_NEAR(end.x(), starts[static_cast<std::size_t>(n)].x(), 1e-3) << n;
  }
}

TEST(Contact, PublishesForcesNormalsAndAreas) {
  NodesOnPlane scene(0.5);
  scene.gravity(0.2);
  scene.run(300, 1.0 / 90);
  Contacts message = testing::contact_message(scene.rig.contacts, scene.rig.state, {1});
  ASSERT_EQ(message.contacts.size(), 3u);
  const FingerContact& finger = message.fingers[static_cast<std::size_t>(Finger::index)];
  EXPECT_EQ(finger.contact_count, 3u);
  EXPECT_EQ(finger.object, 1u);
  EXPECT_NEAR(finger.force[1], 0.03 * kGravity * std::cos(0.2), 1e-4);
  EXPECT_NEAR(finger.force[0], -0.03 * kGravity * std::sin(0.2), 1e-4);
  EXPECT_NEAR(finger.normal[1], 1, 1e-12);
  EXPECT_NEAR(finger.area, 0.5 * 0.01 * 0.01, 1e-12);
  EXPECT_EQ(message.contacts[0].flags, kContactSticking);
  EXPECT_EQ(message.fingers[static_cast<std::size_t>(Finger::thumb)].contact_count, 0u);
  EXPECT_NEAR(message.contacts[0].penetration, 0.01 * kGravity * std::cos(0.2) / 500, 1e-7);

  scene.rig.contacts.clear_object(0);
  message = testing::contact_message(scene.rig.contacts, scene.rig.state, {1});
  EXPECT_EQ(message.contacts.size(), 0u);
}

// A step may carry nodes across a surface to which they were not moving. They touch it without pressure. The published
// object of the finger must be this one, not the first object.
TEST(Contact, NamesAnObjectTouchedWithoutPressure) {
  ContactRig rig(4, 1000, 1e-4, 0, 2);
  const ShapeGeometry ball(shape_of(ShapeKind::sphere, {0.02, 0, 0})),
      table(shape_of(ShapeKind::box, {0.5, 0.02, 0.5}));
  rig.contacts.set_object(0, &ball, 0.5, 7, ContactObject::fixed);
  rig.contacts.set_object(1, &table, 0.5, 9, ContactObject::fixed);
  rig.state.body_poses[0].position = {5, 5, 5};
  rig.state.body_poses[1].position = {0, -0.02 - 1e-4, 0};
  rig.contacts.begin_step(rig.state, 1.0 / 90);
  rig.state.node_positions.row(1).array() -= 2e-4;
  rig.contacts.end_step(rig.state);
  const Contacts message = testing::contact_message(rig.contacts, rig.state, {7, 9});
  const FingerContact& finger = message.fingers[static_cast<std::size_t>(Finger::index)];
  EXPECT_EQ(finger.contact_count, 12u);
  EXPECT_EQ(finger.object, 9u);
  EXPECT_EQ(finger.force, Vec3{});
}

TEST(Contact, MemoryOfOtherObjectsIsRefused) {
  ContactRig rig(1, 700, 1e-4), other(1, 700, 1e-4);
  const ShapeGeometry ball(shape_of(ShapeKind::sphere, {0.05, 0, 0}));
  rig.contacts.set_object(0, &ball, 0.5, 7, ContactObject::fixed);
  const ContactSet::Memory memory = rig.contacts.save();
  EXPECT_THROW(other.contacts.load(memory), std::invalid_argument);
  other.contacts.set_object(0, &ball, 0.5, 8, ContactObject::fixed);
  EXPECT_THROW(other.contacts.load(memory), std::invalid_argument);
  other.contacts.set_object(0, &ball, 0.5, 7, ContactObject::fixed);
  EXPECT_NO_THROW(other.contacts.load(memory));
}

// A memory is compared byte by byte when a recorded run is repeated.
TEST(Contact, AClearedSlotHasTheMemoryOfANewOne) {
  ContactRig rig(1, 700, 1e-4);
  const std::vector<std::byte> fresh = testing::bytes_of(rig.contact);
  const ShapeGeometry ball(shape_of(ShapeKind::sphere, {0.05, 0, 0}));
  rig.state.body_poses[0].position = {1, 0, 0};  // out of reach
  rig.contacts.set_object(0, &ball, 0.5, 7, ContactObject::fixed);
  rig.contact.begin_step(rig.state, 0.01);
  rig.contact.end_step(rig.state);
  EXPECT_NE(testing::bytes_of(rig.contact), fresh);
  rig.contacts.clear_object(0);
  EXPECT_EQ(testing::bytes_of(rig.contact), fresh);
}

// Nodes slide on the inside of a ring of thin plates. In one step a node slides past the next plate, whose outer side
// is then nearer than its inner side.
TEST(Contact, SlidingInsideAThinRingDoesNotLeadOut) {
  constexpr int kPlates = 12;
  constexpr double kRadius = 0.02, kThickness = 0.001, kWidth = 0.03;
  const auto plate = std::make_shared<const ShapeGeometry>(shape_of(ShapeKind::box, {0.0057, kThickness / 2, kWidth}));
  std::vector<PosedShape> plates;
  for (int i = 0; i < kPlates; ++i) {
    const Quaternion turn = rotation_exp(Vector3(0, 0, 2 * M_PI * i / kPlates));
    plates.push_back({plate, {turn * Vector3(0, -kRadius - kThickness / 2, 0), turn}});
  }
  const ShapeGeometry ring(std::move(plates));
  for (const double speed : {0.2, 0.35, 0.5}) {
    for (const double friction : {0.0, 0.3}) {
      ContactRig rig(1, 700, 1e-3);
      rig.contacts.set_object(0, &ring, friction, 1, ContactObject::fixed);
      rig.inertia.hold(0);
      rig.inertia.set_node_gravity(Vector3(0, -kGravity, 0));
      for (int n = 0; n < 3; ++n) {
        rig.state.node_positions.col(n) = Vector3(0.002 * n, -kRadius + 1e-5, 0);
        rig.state.node_velocities.col(n) = Vector3(speed, 0, 0);
      }
      testing::DenseStepper stepper = rig.stepper();
      for (int i = 0; i < 60; ++i) stepper.step(rig.state, 1.0 / 90);
      EXPECT_LE(rig.state.node_positions.colwise().norm().maxCoeff(), kRadius / std::cos(M_PI / kPlates) + 1e-3)
          << speed << " m/s, friction " << friction;
    }
  }
}

TEST(Contact, RefusesBadNumbers) {
  ContactRig rig(1, 500, 1e-3, 1, 2);
  const ShapeGeometry plane(shape_of(ShapeKind::plane));
  EXPECT_THROW(rig.contacts.set_object(0, nullptr, 0.5, 1, ContactObject::fixed), std::invalid_argument);
  EXPECT_THROW(rig.contacts.set_object(0, &plane, -0.5, 1, ContactObject::fixed), std::invalid_argument);
  EXPECT_THROW(rig.contacts.set_object(1, &plane, 0.5, 1, ContactObject::moving), std::invalid_argument);
  EXPECT_THROW(ContactSet(testing::contact_at_nodes(rig.hand, std::vector<double>(3, 1e-3)), 3, 0, 0, 1, 1),
               std::invalid_argument);
}

}  // namespace
}  // namespace softhand::contact_test
