// A sharp point of an object between the contact points of the skin.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "energies/contact_rig.hpp"
#include "energies/derivative_suite.hpp"

namespace softhand::sharp_point_test {
namespace {

using testing::shape_of;
using testing::skin_triangles;

// A needle with its tip 0.2 mm above the middle of a triangle that has no contact points. It moves down by `speed`.
struct Needle {
  explicit Needle(ContactObject kind, double speed = 0.05)
      : hand(skin_triangles(4)),
        masses(hand.nodes.size(), 1e-4),
        capsule(shape_of(ShapeKind::capsule, {5e-4, 0.02, 0})),
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

class SharpPointDerivatives : public ::testing::TestWithParam<std::uint64_t> {};

TEST_P(SharpPointDerivatives, OfBothTerms) {
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

INSTANTIATE_TEST_SUITE_P(Seeds, SharpPointDerivatives, ::testing::Values(1, 2, 3, 4, 5));

}  // namespace
}  // namespace softhand::sharp_point_test
