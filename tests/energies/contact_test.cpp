// Contact and friction of points of the skin (eqs. 32, 33): derivatives, balance, known results, no tunnelling, no
// creep.
#include "energies/contact.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "contact/coulomb.hpp"
#include "energies/dense_step.hpp"
#include "energies/derivative_suite.hpp"
#include "energies/friction.hpp"
#include "energies/inertia.hpp"
#include "energies/memory_suite.hpp"
#include "math/rotation.hpp"
#include "support/node_contact.hpp"

namespace softhand {
namespace {

constexpr double kGravity = 9.81;

Shape make(ShapeKind kind, Vec3 size = {}) {
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(kind);
  shape.size = size;
  return shape;
}

// `triangles` separate triangles of skin, all of the same size, so that all nodes have the same stiffness.
HandModel skin(int triangles) {
  HandModel hand;
  for (int t = 0; t < triangles; ++t) {
    const Vector3 centre(0.05 * t, 0, 0);
    for (const Vector3& corner : {Vector3(0, 0, 0), Vector3(0, 0, 0.01), Vector3(0.01, 0, 0)})
      hand.nodes.push_back(centre + corner);
    hand.surface.push_back({3 * t, 3 * t + 1, 3 * t + 2});
  }
  hand.node_body.assign(hand.nodes.size(), static_cast<std::uint8_t>(index_of(Body::index_distal)));
  return hand;
}

struct Rig {
  Rig(int triangles, double stiffness, double node_mass, int moving_slots = 1, int slots = 1)
      : hand(skin(triangles)),
        contacts(testing::contact_at_nodes(hand, std::vector<double>(hand.nodes.size(), node_mass)), hand.node_count(),
                 testing::contact_stiffness(hand, stiffness), 0, moving_slots, slots),
        contact(contacts),
        friction(contacts),
        inertia(std::vector<double>(hand.nodes.size(), node_mass), slots) {
    state.node_positions.resize(3, hand.node_count());
    state.node_velocities = Eigen::Matrix3Xd::Zero(3, hand.node_count());
    for (int n = 0; n < hand.node_count(); ++n) state.node_positions.col(n) = hand.nodes[static_cast<std::size_t>(n)];
    state.body_poses.resize(static_cast<std::size_t>(slots));
    state.body_velocities.resize(static_cast<std::size_t>(slots));
  }
  testing::DenseStepper stepper() { return testing::DenseStepper({&inertia, &contact, &friction}, state); }

  HandModel hand;
  ContactSet contacts;
  ContactEnergy contact;
  FrictionEnergy friction;
  Inertia inertia;
  State state;
};

// A scene in which every branch occurs. Next to a moving object, nodes penetrate, stick, slide, or are about to cross.
struct RandomScene {
  explicit RandomScene(std::uint64_t seed, ContactObject kind = ContactObject::moving)
      : sphere(make(ShapeKind::sphere, {0.05, 0, 0})), rig(4, 700, 1e-4) {
    rig.contacts.set_object(0, &sphere, 0.7, 5, kind);
    rig.state = testing::random_state(rig.state.layout(), seed, 0.2, 0.3);
    std::mt19937_64 generator(seed);
    const auto uniform = [&generator] { return 2.0 * static_cast<double>(generator() >> 11) * 0x1p-53 - 1.0; };
    const Pose& body = rig.state.body_poses[0];
    for (int n = 0; n < rig.hand.node_count(); ++n) {
      const double x = uniform(), y = uniform(), z = uniform();
      const Vector3 direction = Vector3(x, y, z).normalized();
      const double height = n % 3 == 0 ? 0.002 : 0.0005;
      rig.state.node_positions.col(n) = body.position + (0.05 + height) * direction;
      rig.state.node_velocities.col(n) =
          rig.state.body_velocities[0].linear - 0.3 * direction + 0.2 * direction.unitOrthogonal();
    }
    // In the first step all nodes cross the surface. They are moved to where they penetrate. Then the second step
    // starts.
    rig.contacts.begin_step(rig.state, 0.01);
    for (int n = 0; n < rig.hand.node_count(); ++n)
      rig.state.node_positions.col(n) += 0.01 * rig.state.node_velocities.col(n);
    rig.contacts.end_step(rig.state);
    // Half of the nodes are pushed deeper, the others stay.
    for (int n = 0; n < rig.hand.node_count(); n += 2) {
      const Vector3 outward = (Vector3(rig.state.node_positions.col(n)) - body.position).normalized();
      rig.state.node_positions.col(n) -= 0.002 * outward;
    }
  }
  ShapeGeometry sphere;
  Rig rig;
};

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

class ContactDerivatives : public ::testing::TestWithParam<std::uint64_t> {};

TEST_P(ContactDerivatives, OfBothTermsOnAMovingObject) {
  RandomScene scene(GetParam());
  ASSERT_GT(scene.rig.contacts.count(), 6);
  const State moved = testing::perturbed(scene.rig.state, GetParam(), 4e-4, 5e-3);
  testing::check_term(scene.rig.contact, scene.rig.state, 0.01, moved, {.step = 1e-7, .tolerance = 1e-4});
  scene.rig.contacts.begin_step(scene.rig.state, 0.01);
  testing::check_term(scene.rig.friction, scene.rig.state, 0.01, moved, {.step = 1e-7, .tolerance = 1e-4});
  int sliding = 0, sticking = 0;
  for (const auto& anchor : scene.rig.contacts.anchors()) {
    if (!(anchor.friction_bound > 0)) continue;
    const double stretch = scene.rig.contacts.offset(anchor, moved).stretch.norm();
    (CoulombSpring{anchor.friction_stiffness, anchor.friction_bound}.slides(stretch) ? sliding : sticking) += 1;
  }
  EXPECT_GT(sliding + sticking, 3);
}

TEST_P(ContactDerivatives, OfFreshAnchors) {
  RandomScene scene(GetParam());
  scene.rig.contacts.reset();
  const Vector3 centre = scene.rig.state.body_poses[0].position;
  for (int n = 0; n < scene.rig.hand.node_count(); ++n) {
    const Vector3 outward = (Vector3(scene.rig.state.node_positions.col(n)) - centre).normalized();
    scene.rig.state.node_positions.col(n) = centre + 0.051 * outward;
  }
  const State moved = testing::perturbed(scene.rig.state, GetParam(), 4e-4, 5e-3);
  testing::check_term(scene.rig.contact, scene.rig.state, 0.01, moved, {.step = 1e-7, .tolerance = 1e-4});
  ASSERT_GT(scene.rig.contacts.count(), 6);
  for (const auto& anchor : scene.rig.contacts.anchors()) EXPECT_TRUE(anchor.fresh);
  testing::check_term(scene.rig.friction, scene.rig.state, 0.01, moved, {.step = 1e-7, .tolerance = 1e-4});
}

TEST_P(ContactDerivatives, OfAFixedObjectActOnNodesOnly) {
  RandomScene scene(GetParam(), ContactObject::fixed);
  const State moved = testing::perturbed(scene.rig.state, GetParam(), 4e-4, 5e-3);
  testing::check_term(scene.rig.contact, scene.rig.state, 0.01, moved, {.step = 1e-7, .tolerance = 1e-4});
  VectorX gradient = VectorX::Zero(moved.layout().dof_count());
  scene.rig.contact.add_gradient(moved, gradient);
  EXPECT_EQ(gradient.tail<6>().norm(), 0);
  EXPECT_GT(scene.rig.contacts.count(0), 0);
}

TEST_P(ContactDerivatives, ForcesBalanceAndRigidMotionIsFree) {
  RandomScene scene(GetParam());
  scene.rig.contacts.begin_step(scene.rig.state, 0.01);
  const State moved = testing::perturbed(scene.rig.state, GetParam(), 4e-4, 5e-3);
  const Pose motion{Vector3(0.3, -0.2, 0.5), Quaternion(0.3, 0.7, -0.2, 0.5).normalized()};
  for (const Energy* term :
       {static_cast<const Energy*>(&scene.rig.contact), static_cast<const Energy*>(&scene.rig.friction)}) {
    testing::check_balance(*term, moved);
    testing::check_rigid_motion(*term, moved, motion);
  }
}

// Contact points between the nodes: the middle of each triangle, and of one edge.
std::vector<ContactPoint> points_between_nodes(const HandModel& hand) {
  std::vector<ContactPoint> points;
  for (const auto& triangle : hand.surface) {
    ContactPoint point;
    point.body = hand.node_body[0];
    point.area = 2e-5;
    point.node_count = 3;
    for (std::size_t k = 0; k < 3; ++k) point.nodes[k] = triangle[k], point.weights[k] = 1.0 / 3;
    points.push_back(point);
    point.node_count = 2;
    point.weights = {0.75, 0.25};
    points.push_back(point);
  }
  return points;
}

TEST_P(ContactDerivatives, OfPointsBetweenNodes) {
  const HandModel hand = skin(4);
  const std::vector<double> masses(hand.nodes.size(), 1e-4);
  ContactSet contacts(ContactPoints(points_between_nodes(hand), masses), hand.node_count(), 700 / 2e-5, 0, 1, 1);
  ContactEnergy contact(contacts);
  FrictionEnergy friction(contacts);
  const ShapeGeometry sphere(make(ShapeKind::sphere, {0.05, 0, 0}));
  contacts.set_object(0, &sphere, 0.7, 5, ContactObject::moving);
  RandomScene scene(GetParam());
  State& state = scene.rig.state;
  const Vector3 centre = state.body_poses[0].position;
  // Each triangle becomes small and moves into the sphere.
  for (const auto& triangle : hand.surface) {
    const Vector3 outward = (Vector3(state.node_positions.col(triangle[0])) - centre).normalized();
    for (std::size_t k = 0; k < 3; ++k) {
      const Vector3 corner =
          5e-4 * Vector3(Vector3::Unit(static_cast<int>(k)) - outward[static_cast<int>(k)] * outward);
      state.node_positions.col(triangle[k]) = centre + 0.0505 * outward + corner;
      state.node_velocities.col(triangle[k]) = state.body_velocities[0].linear - 0.3 * outward;
    }
  }
  contacts.begin_step(state, 0.01);
  state.node_positions += 0.01 * state.node_velocities;
  contacts.end_step(state);
  ASSERT_GT(contacts.count(), 3);
  const State moved = testing::perturbed(state, GetParam(), 2e-4, 2e-3);
  testing::check_term(contact, state, 0.01, moved, {.step = 1e-7, .tolerance = 1e-4});
  contacts.begin_step(state, 0.01);
  testing::check_term(friction, state, 0.01, moved, {.step = 1e-7, .tolerance = 1e-4});
  testing::check_balance(contact, moved);
  testing::check_balance(friction, moved);
}

// A point of weight 1/3 on three nodes has three times their mass, and its main node is the heaviest one.
TEST(ContactPoints, HaveMassAndMainNode) {
  const HandModel hand = skin(2);
  const ContactPoints points(points_between_nodes(hand), std::vector<double>(hand.nodes.size(), 1e-4));
  EXPECT_NEAR(points.mass(0), 3e-4, 1e-12);
  EXPECT_NEAR(points.mass(1), 1e-4 / (0.75 * 0.75 + 0.25 * 0.25), 1e-12);
  EXPECT_EQ(points.main_node(2), 3);
  const ContactPoints nodes = testing::contact_at_nodes(hand, std::vector<double>(hand.nodes.size(), 1e-4));
  EXPECT_EQ(nodes.count(), 6);
  EXPECT_EQ(nodes.mass(5), 1e-4);
  ContactPoint bad;
  bad.area = 1e-5;
  bad.weights[0] = 0.9;
  EXPECT_THROW(ContactPoints({bad}, {1e-4}), std::invalid_argument);
  bad.weights[0] = 1;
  bad.nodes[0] = 1;
  EXPECT_THROW(ContactPoints({bad}, {1e-4}), std::invalid_argument);
}

// A needle with its tip 0.2 mm above the middle of a triangle that has no contact points. It moves down by `speed`.
struct Needle {
  explicit Needle(ContactObject kind, double speed = 0.05)
      : hand(skin(4)),
        masses(hand.nodes.size(), 1e-4),
        capsule(make(ShapeKind::capsule, {5e-4, 0.02, 0})),
        contacts(ContactPoints(hand, masses), hand.node_count(), 5e7, 0, 1, 1),
        contact(contacts),
        friction(contacts) {
    contacts.set_object(0, &capsule, 0.7, 5, kind);
    state.node_positions.resize(3, hand.node_count());
    state.node_velocities = Eigen::Matrix3Xd::Zero(3, hand.node_count());
    for (int n = 0; n < hand.node_count(); ++n) state.node_positions.col(n) = hand.nodes[static_cast<std::size_t>(n)];
    state.body_poses = {Pose{Vector3(0.003, 0.0207, 0.003), Quaternion::Identity()}};
    state.body_velocities.resize(1);
    state.body_velocities[0].linear = Vector3(0, -speed, 0);
  }
  // The object's motion is given, and the skin is held.
  void step() {
    contacts.begin_step(state, kTimeStep);
    contacts.end_step(state);
    state.body_poses[0] = advanced(state.body_poses[0], state.body_velocities[0], kTimeStep);
  }
  static constexpr double kTimeStep = 0.01;
  HandModel hand;
  std::vector<double> masses;
  ShapeGeometry capsule;
  ContactSet contacts;
  ContactEnergy contact;
  FrictionEnergy friction;
  State state;
};

TEST_P(ContactDerivatives, OfASharpPoint) {
  Needle needle(ContactObject::moving);
  State& state = needle.state;
  needle.contacts.begin_step(state, Needle::kTimeStep);
  state.body_poses[0].position.y() -= 5e-4;
  needle.contacts.end_step(state);
  ASSERT_EQ(needle.contacts.count(), 1);
  EXPECT_GE(needle.contacts.anchors()[0].sharp, 0);
  EXPECT_NEAR(needle.contacts.anchors()[0].force.y(), -3e-4 * 5e7 * ContactSet::sharp_area, 1e-3);
  EXPECT_NEAR(needle.contacts.wrench(0).force.y(), 3e-4 * 5e7 * ContactSet::sharp_area, 1e-3);
  const State moved = testing::perturbed(state, GetParam(), 1e-4, 2e-3);
  testing::check_term(needle.contact, state, 0.01, moved, {.step = 1e-7, .tolerance = 1e-4});
  needle.contacts.begin_step(state, 0.01);
  testing::check_term(needle.friction, state, 0.01, moved, {.step = 1e-7, .tolerance = 1e-4});
  testing::check_balance(needle.contact, moved);
  testing::check_balance(needle.friction, moved);
}

TEST(SharpPoint, IsFeltSlidesAndLeaves) {
  Needle needle(ContactObject::fixed);
  needle.step();
  ASSERT_EQ(needle.contacts.count(), 1);
  // It slides over the skin at 0.05 m/s. The skin's point stays below the tip, and the drag is mu f_n.
  needle.state.body_velocities[0].linear = Vector3(0.05, 0, 0);
  for (int i = 0; i < 6; ++i) needle.step();
  ASSERT_EQ(needle.contacts.count(), 1);
  const ContactAnchor& anchor = needle.contacts.anchors()[0];
  const Vector3 tip = needle.state.body_poses[0].position - Vector3(0, 0.0205, 0);
  EXPECT_NEAR(tip.x(), 0.006, 1e-9);
  EXPECT_NEAR(needle.contacts.position(anchor, needle.state).x(), tip.x(), 5e-4);
  EXPECT_NEAR(std::abs(anchor.force.x()), 0.7 * std::abs(anchor.force.y()), 0.02 * std::abs(anchor.force.y()));
  // A copy of the memory continues with the same bits.
  Needle other(ContactObject::fixed);
  other.state = needle.state;
  other.contacts.load(needle.contacts.save());
  needle.step();
  other.step();
  ASSERT_EQ(other.contacts.count(), 1);
  EXPECT_EQ(other.contacts.anchors()[0].force, needle.contacts.anchors()[0].force);
  // A step that is cancelled leaves the place of the contact.
  const Vector3 place = needle.contacts.position(needle.contacts.anchors()[0], needle.state);
  needle.contacts.begin_step(needle.state, Needle::kTimeStep);
  needle.contacts.cancel_step();
  EXPECT_EQ(needle.contacts.position(needle.contacts.anchors()[0], needle.state), place);
  needle.state.body_velocities[0].linear = Vector3(0, 0.1, 0);
  for (int i = 0; i < 3; ++i) needle.step();
  EXPECT_EQ(needle.contacts.count(), 0);
}

// The tip leaves the skin over its edge, at the same height.
TEST(SharpPoint, EndsWhereThereIsNoSkin) {
  Needle needle(ContactObject::fixed);
  needle.step();
  needle.state.body_velocities[0].linear = Vector3(-0.1, 0, 0);
  for (int i = 0; i < 15; ++i) needle.step();
  EXPECT_EQ(needle.contacts.count(), 0);
}

TEST(SharpPoint, OfAnObjectThatStaysOutsideIsNotFelt) {
  Needle needle(ContactObject::fixed, 0.01);
  needle.step();
  EXPECT_EQ(needle.contacts.count(), 0);
}

INSTANTIATE_TEST_SUITE_P(Seeds, ContactDerivatives, ::testing::Values(1, 2, 3, 4, 5));

// Nodes of mass m on a fixed plane under gravity g.
struct NodesOnPlane {
  explicit NodesOnPlane(double mu, double stiffness = 500, double mass = 0.01, double height = 0.0)
      : plane(make(ShapeKind::plane)), rig(1, stiffness, mass), step(rig.stepper()) {
    rig.contacts.set_object(0, &plane, mu, 1, ContactObject::fixed);
    rig.inertia.hold(0);
    rig.state.node_positions.row(1).setConstant(height);
  }
  void gravity(double angle) { rig.inertia.set_node_gravity(kGravity * Vector3(std::sin(angle), -std::cos(angle), 0)); }
  void run(int steps, double dt, double tolerance = 1e-13) {
    for (int i = 0; i < steps; ++i) step.step(rig.state, dt, tolerance);
  }
  Vector3 position() const { return rig.state.node_positions.col(0); }
  Vector3 velocity() const { return rig.state.node_velocities.col(0); }
  ShapeGeometry plane;
  Rig rig;
  testing::DenseStepper step;
};

TEST(Contact, RestDepthIsWeightOverStiffness) {
  NodesOnPlane scene(0.5, 500, 0.01, 0.002);
  scene.gravity(0);
  scene.run(2000, 1.0 / 90);
  EXPECT_NEAR(scene.position().y(), -0.01 * kGravity / 500, 1e-9);
  EXPECT_NEAR(scene.rig.contacts.wrench(0).force.y(), -3 * 0.01 * kGravity, 1e-6);
  EXPECT_NEAR(scene.rig.contacts.penetration_quantile(scene.rig.state, 1.0), 0.01 * kGravity / 500, 1e-9);
  EXPECT_EQ(scene.rig.contacts.count(), 3);
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
  const ShapeGeometry plate(make(ShapeKind::box, {0.5, 0.00025, 0.5}));
  for (const bool moving : {false, true}) {
    int through = 0;
    for (int trial = 0; trial < 1000; ++trial) {
      Rig rig(1, 500, 1e-3);
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
  const ShapeGeometry plate(make(ShapeKind::box, {0.5, 0.00025, 0.5}));
  Rig rig(1, 500, 1e-3);
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
  const ShapeGeometry plate(make(ShapeKind::box, {0.5, 0.00025, 0.5}));
  Rig rig(1, 500, 1e-3);
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
  const ShapeGeometry plate(make(ShapeKind::box, {0.5, 0.00025, 0.5}));
  Rig rig(1, 500, 1e-3);
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
  const ShapeGeometry drum(make(ShapeKind::cylinder, {kRadius, 0.5, 0}));
  Rig rig(1, kStiffness, kMass);
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
  const ShapeGeometry drum(make(ShapeKind::cylinder, {kRadius, 0.5, 0}));
  const Quaternion lying(Eigen::AngleAxisd(M_PI / 2, Vector3::UnitX()));
  const auto heights = [&](double height, double spin) {
    Rig rig(1, 50, 1e-3);
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
    const ShapeGeometry round(make(kind, {0.03, 0.03, 0}));
    for (const double speed : {10.0, 30.0, 100.0}) {
      for (const double gap : {1e-6, 1e-4, 1e-3}) {
        Rig rig(1, 700, 1e-4);
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
  const ShapeGeometry blade(make(ShapeKind::box, {0.05, 0.0005, 0.05})), cube(make(ShapeKind::box, {0.03, 0.03, 0.03}));
  const auto touched = [](const ShapeGeometry& shape, const Vector3& spin, const Vector3& node) {
    Rig rig(1, 700, 1e-4);
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
  const ShapeGeometry box(make(ShapeKind::box, {0.04, 0.04, 0.04}));
  for (const double dt : {1.0 / 90, 1.0 / 1000}) {
    Rig rig(1, 2000, 1e-3);
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

// A node is dragged around a fixed cylinder. Its anchor follows the surface. The anchor's normal follows the radius.
TEST(Friction, AnchorFollowsACurvedSurface) {
  const ShapeGeometry cylinder(make(ShapeKind::cylinder, {0.02, 0.5, 0}));
  Rig rig(1, 1000, 1e-3);
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

TEST(Contact, PublishesForcesNormalsAndAreas) {
  NodesOnPlane scene(0.5);
  scene.gravity(0.2);
  scene.run(300, 1.0 / 90);
  Contacts message{};
  scene.rig.contacts.write(scene.rig.state, message);
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
  scene.rig.contacts.write(scene.rig.state, message);
  EXPECT_EQ(message.contacts.size(), 0u);
}

// A step may carry nodes across a surface to which they were not moving. They touch it without pressure. The published
// object of the finger must be this one, not the first object.
TEST(Contact, NamesAnObjectTouchedWithoutPressure) {
  Rig rig(4, 1000, 1e-4, 0, 2);
  const ShapeGeometry ball(make(ShapeKind::sphere, {0.02, 0, 0})), table(make(ShapeKind::box, {0.5, 0.02, 0.5}));
  rig.contacts.set_object(0, &ball, 0.5, 7, ContactObject::fixed);
  rig.contacts.set_object(1, &table, 0.5, 9, ContactObject::fixed);
  rig.state.body_poses[0].position = {5, 5, 5};
  rig.state.body_poses[1].position = {0, -0.02 - 1e-4, 0};
  rig.contacts.begin_step(rig.state, 1.0 / 90);
  rig.state.node_positions.row(1).array() -= 2e-4;
  rig.contacts.end_step(rig.state);
  Contacts message{};
  rig.contacts.write(rig.state, message);
  const FingerContact& finger = message.fingers[static_cast<std::size_t>(Finger::index)];
  EXPECT_EQ(finger.contact_count, 12u);
  EXPECT_EQ(finger.object, 9u);
  EXPECT_EQ(finger.force, Vec3{});
}

// Nodes slide, stick and leave the ball, which moves under them. `moving`: by the solver.
TEST_P(ContactDerivatives, MemoryRepeatsTheBits) {
  for (const ContactObject kind : {ContactObject::moving, ContactObject::fixed}) {
    RandomScene scene(GetParam(), kind);
    if (kind == ContactObject::moving) scene.rig.inertia.set_dynamic(0, 0.1, 1e-4 * Matrix3::Identity(), {0, -1, 0});
    testing::DenseStepper stepper = scene.rig.stepper();
    // At the start of the last step of each run the object is moved by the caller: a path between the steps.
    int steps = 0;
    testing::check_memory(scene.rig.contact, scene.rig.state, [&](State& state) {
      if (++steps % 5 == 3) state.body_poses[0].position.x() += 1e-3;
      stepper.step(state, 0.01);
    });
  }
}

TEST(Contact, MemoryOfOtherObjectsIsRefused) {
  Rig rig(1, 700, 1e-4), other(1, 700, 1e-4);
  const ShapeGeometry ball(make(ShapeKind::sphere, {0.05, 0, 0}));
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
  Rig rig(1, 700, 1e-4);
  const std::vector<std::byte> fresh = testing::bytes_of(rig.contact);
  const ShapeGeometry ball(make(ShapeKind::sphere, {0.05, 0, 0}));
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
  const auto plate = std::make_shared<const ShapeGeometry>(make(ShapeKind::box, {0.0057, kThickness / 2, kWidth}));
  std::vector<PosedShape> plates;
  for (int i = 0; i < kPlates; ++i) {
    const Quaternion turn = rotation_exp(Vector3(0, 0, 2 * M_PI * i / kPlates));
    plates.push_back({plate, {turn * Vector3(0, -kRadius - kThickness / 2, 0), turn}});
  }
  const ShapeGeometry ring(std::move(plates));
  for (const double speed : {0.2, 0.35, 0.5}) {
    for (const double friction : {0.0, 0.3}) {
      Rig rig(1, 700, 1e-3);
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
  Rig rig(1, 500, 1e-3, 1, 2);
  const ShapeGeometry plane(make(ShapeKind::plane));
  EXPECT_THROW(rig.contacts.set_object(0, nullptr, 0.5, 1, ContactObject::fixed), std::invalid_argument);
  EXPECT_THROW(rig.contacts.set_object(0, &plane, -0.5, 1, ContactObject::fixed), std::invalid_argument);
  EXPECT_THROW(rig.contacts.set_object(1, &plane, 0.5, 1, ContactObject::moving), std::invalid_argument);
  EXPECT_THROW(ContactSet(testing::contact_at_nodes(rig.hand, std::vector<double>(3, 1e-3)), 3, 0, 0, 1, 1),
               std::invalid_argument);
}

}  // namespace
}  // namespace softhand
