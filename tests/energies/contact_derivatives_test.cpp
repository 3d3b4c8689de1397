// Contact and friction of points of the skin (eqs. 32, 33): derivatives, balance, and memory.
#include <gtest/gtest.h>

#include <random>

#include "energies/contact_rig.hpp"
#include "energies/derivative_suite.hpp"
#include "energies/memory_suite.hpp"

namespace softhand::contact_derivatives_test {
namespace {

using testing::ContactRig;
using testing::shape_of;
using testing::skin_triangles;

// A scene in which every branch occurs. Next to a moving object, nodes penetrate, stick, slide, or are about to cross.
struct RandomScene {
  explicit RandomScene(std::uint64_t seed, ContactObject kind = ContactObject::moving)
      : sphere(shape_of(ShapeKind::sphere, {0.05, 0, 0})), rig(4, 700, 1e-4) {
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
  ContactRig rig;
};

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
  const HandModel hand = skin_triangles(4);
  const std::vector<double> masses(hand.nodes.size(), 1e-4);
  ContactSet contacts(ContactPoints(points_between_nodes(hand), masses), hand.node_count(), 700 / 2e-5, 0, 1, 1);
  ContactEnergy contact(contacts);
  FrictionEnergy friction(contacts);
  const ShapeGeometry sphere(shape_of(ShapeKind::sphere, {0.05, 0, 0}));
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
  const HandModel hand = skin_triangles(2);
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

INSTANTIATE_TEST_SUITE_P(Seeds, ContactDerivatives, ::testing::Values(1, 2, 3, 4, 5));

}  // namespace
}  // namespace softhand::contact_derivatives_test
