// Contacts of other hands with an object: derivatives, and the wrench as it was published.
#include "energies/other_hands.hpp"

#include <gtest/gtest.h>

#include "energies/derivative_suite.hpp"
#include "messages/convert.hpp"

namespace softhand::other_hands_test {
namespace {

constexpr double kTimeStep = 1.0 / 90;

ContactPatch patch_at(const Vector3& point) {
  ContactPatch patch;
  patch.point = to_wire(point);
  patch.normal = to_wire(Vector3(0.6, 0, -0.8));
  patch.force = to_wire(Vector3(1.9, 0.7, -2.2));
  patch.torque = to_wire(Vector3(0.002, -0.004, 0.001));
  patch.linear_velocity = to_wire(Vector3(0.1, 0.2, -0.3));
  patch.angular_velocity = to_wire(Vector3(0.5, -1, 0.2));
  patch.stiffness = 2000;
  patch.radius = 0.004;
  patch.friction = 0.8;
  return patch;
}

// Body 1 is the object of slot 0. Body 0 is a bone.
struct Touched {
  explicit Touched(std::uint64_t seed = 3) : state(testing::random_state({0, 2}, seed)), term({0, 2}, 1, 1) {}
  Vector3 point() const { return state.body_poses[1] * Vector3(0.01, -0.02, 0.015); }
  Wrench wrench(const State& at) {
    State end = at;
    const BlockMatrix matrix = testing::bound_matrix(term, state);
    term.begin_step(state, kTimeStep);
    term.end_step(end);
    return term.wrench(0);
  }
  State state;
  OtherHands term;
};

TEST(OtherHands, DerivativesWhileTheyStick) {
  Touched t;
  t.term.add(0, patch_at(t.point()), t.state.body_poses[1], 0);
  testing::check_term(t.term, t.state, kTimeStep, testing::perturbed(t.state, 5, 1e-4, 1e-3));
}

TEST(OtherHands, DerivativesWhileTheySlideAndTwist) {
  for (const std::uint64_t seed : {1u, 2u, 3u}) {
    Touched t(seed);
    t.term.add(0, patch_at(t.point()), t.state.body_poses[1], 0.02);
    t.term.add(0, patch_at(t.state.body_poses[1] * Vector3(-0.02, 0.01, 0)), t.state.body_poses[1], 0.01);
    testing::check_term(t.term, t.state, kTimeStep, testing::perturbed(t.state, 10 + seed, 0.01, 0.3));
  }
}

TEST(OtherHands, ObjectThatMovesWithThePatchFeelsThePublishedWrench) {
  Touched t;
  const ContactPatch patch = patch_at(t.point());
  const double age = 0.03;
  t.term.add(0, patch, t.state.body_poses[1], age);
  State moved = t.state;
  Pose& body = moved.body_poses[1];
  const Quaternion turn = rotation_exp(age * to_vector(patch.angular_velocity));
  const Vector3 arm = turn * Vector3(t.point() - body.position);
  body.position = t.point() + age * to_vector(patch.linear_velocity) - arm;
  body.orientation = turn * body.orientation;
  const Wrench wrench = t.wrench(moved);
  EXPECT_LT((wrench.force - to_vector(patch.force)).norm(), 1e-9);
  EXPECT_LT((wrench.torque - arm.cross(to_vector(patch.force)) - to_vector(patch.torque)).norm(), 1e-9);
}

TEST(OtherHands, NeverPullAndNeverExceedFriction) {
  Touched t;
  const ContactPatch patch = patch_at(t.point());
  const Vector3 normal = to_vector(patch.normal);
  const double pressing = to_vector(patch.force).dot(normal);
  t.term.add(0, patch, t.state.body_poses[1], 0);
  State away = t.state;
  away.body_poses[1].position += 2 * pressing / patch.stiffness * normal;
  EXPECT_LT(std::abs(t.wrench(away).force.dot(normal)), 1e-12);
  State across = t.state;
  across.body_poses[1].position += 0.05 * Vector3::UnitY();  // tangential
  const Vector3 force = t.wrench(across).force;
  EXPECT_NEAR((force - force.dot(normal) * normal).norm(), patch.friction * pressing, 1e-9);
}

TEST(OtherHands, ActOnlyInTheNextStepAndOnlyIfTheyPress) {
  Touched t;
  ContactPatch pulls = patch_at(t.point());
  pulls.force = to_wire(Vector3(-to_vector(pulls.force)));
  t.term.add(0, pulls, t.state.body_poses[1], 0);
  EXPECT_EQ(t.term.value(t.state), 0);
  EXPECT_EQ(t.term.patches_used(), 0u);
  t.term.add(0, patch_at(t.point()), t.state.body_poses[1], 0);
  EXPECT_GT(t.term.value(t.state), 0);
  t.term.clear();
  EXPECT_EQ(t.term.value(t.state), 0);
  EXPECT_EQ(t.wrench(t.state).force.norm(), 0);
}

}  // namespace
}  // namespace softhand::other_hands_test
