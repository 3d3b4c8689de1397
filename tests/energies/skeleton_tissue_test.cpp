// Attachments of eq. 31: the summed form equals the sum of the springs. Also tests derivatives, balance and rest.
#include "energies/skeleton_tissue.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "energies/derivative_suite.hpp"
#include "support/block_hand.hpp"

namespace softhand::skeleton_tissue_test {
namespace {

// The block hand with only a corner of its tissue and a few bodies' attachments, small enough for dense differences. A
// tetrahedron may have several attachments, and bodies share neighbouring tetrahedra.
HandModel small_hand() {
  HandModel hand = testing::block_hand();
  hand.nodes = {{0, 0, 0}, {0.02, 0, 0}, {0, 0.02, 0}, {0, 0, 0.02}, {0.02, 0.02, 0.02}, {0.03, 0, 0.03}};
  hand.tetrahedra = {{0, 1, 2, 3}, {1, 2, 3, 4}, {1, 3, 4, 5}};
  hand.attachments = {
      {3, 0, {0.1, 0.2, 0.3, 0.4}, 900},  {3, 0, {0.4, 0.1, 0.25, 0.25}, 500}, {3, 1, {0.25, 0.25, 0.3, 0.2}, 700},
      {4, 1, {0.6, 0.1, 0.2, 0.1}, 1200}, {4, 2, {0.2, 0.3, 0.3, 0.2}, 300},   {7, 2, {0.05, 0.05, 0.1, 0.8}, 2000},
  };
  return hand;
}

State rest_state(const HandModel& hand) {
  State state;
  state.node_positions.resize(3, hand.node_count());
  state.node_velocities.setZero(3, hand.node_count());
  for (int n = 0; n < hand.node_count(); ++n) state.node_positions.col(n) = hand.nodes[static_cast<std::size_t>(n)];
  for (int b = 0; b < kBodyCount; ++b) {
    state.body_poses.push_back(hand.body_rest_pose(static_cast<Body>(b)));
    state.body_velocities.emplace_back();
  }
  return state;
}

// Eq. 31 as written, spring by spring, with its gradient.
double naive(const HandModel& hand, const State& state, VectorX& gradient) {
  const State rest = rest_state(hand);
  const DofLayout layout = state.layout();
  double energy = 0;
  for (const Attachment& attachment : hand.attachments) {
    const auto& nodes = hand.tetrahedra[static_cast<std::size_t>(attachment.tetrahedron)];
    const auto body = static_cast<std::size_t>(attachment.body);
    Vector3 tissue = Vector3::Zero(), tissue_at_rest = Vector3::Zero();
    for (std::size_t i = 0; i < 4; ++i) {
      tissue += attachment.weights[i] * state.node_positions.col(nodes[i]);
      tissue_at_rest += attachment.weights[i] * rest.node_positions.col(nodes[i]);
    }
    const Vector3 arm = state.body_poses[body].orientation * (rest.body_poses[body].inverse() * tissue_at_rest);
    const Vector3 stretch = state.body_poses[body].position + arm - tissue;
    const Vector3 pull = attachment.stiffness * stretch;
    energy += 0.5 * stretch.dot(pull);
    for (std::size_t i = 0; i < 4; ++i)
      gradient.segment<3>(3 * layout.node_block(nodes[i])) -= attachment.weights[i] * pull;
    gradient.segment<3>(3 * layout.body_translation_block(attachment.body)) += pull;
    gradient.segment<3>(3 * layout.body_rotation_block(attachment.body)) += arm.cross(pull);
  }
  return energy;
}

TEST(SkeletonTissue, EqualsTheSumOfTheSprings) {
  for (const HandModel& hand : {small_hand(), testing::block_hand()}) {
    const State rest = rest_state(hand);
    const SkeletonTissue term(hand, rest.layout());
    for (std::uint64_t seed = 0; seed < 5; ++seed) {
      const State state = testing::perturbed(rest, seed, 0.01, 2.0);
      VectorX expected = VectorX::Zero(state.layout().dof_count()), gradient = expected;
      const double energy = naive(hand, state, expected);
      term.add_gradient(state, gradient);
      EXPECT_NEAR(term.value(state), energy, 1e-12 * energy);
      EXPECT_LE((gradient - expected).lpNorm<Eigen::Infinity>(), 1e-12 * expected.lpNorm<Eigen::Infinity>());
      EXPECT_GT(expected.norm(), 1);
    }
  }
}

TEST(SkeletonTissue, DerivativesAndBalanceAndRigidMotion) {
  const HandModel hand = small_hand();
  const State rest = rest_state(hand);
  SkeletonTissue term(hand, rest.layout());
  for (std::uint64_t seed = 0; seed < 3; ++seed) {
    const State state = testing::perturbed(rest, seed, 0.01, 2.0);
    testing::check_term(term, state, 0.01);
    testing::check_balance(term, state);
    testing::check_rigid_motion(term, state, {Vector3(1, -2, 0.5), rotation_exp(Vector3(2, 1, -1))});
  }
}

TEST(SkeletonTissue, RestHasNoEnergyEvenAKilometreAway) {
  const HandModel hand = testing::block_hand();
  State state = rest_state(hand);
  const SkeletonTissue term(hand, state.layout());
  EXPECT_LE(term.value(state), 1e-25);
  const Pose far{Vector3(1000, -200, 300), rotation_exp(Vector3(1, 2, -1))};
  for (Pose& pose : state.body_poses) pose = far * pose;
  for (int n = 0; n < hand.node_count(); ++n) state.node_positions.col(n) = far * Vector3(state.node_positions.col(n));
  VectorX gradient = VectorX::Zero(state.layout().dof_count());
  term.add_gradient(state, gradient);
  EXPECT_LE(gradient.lpNorm<Eigen::Infinity>(), 1e-7);  // 2e4 N/m times the rounding of a kilometre
  EXPECT_LE(term.value(state), 1e-18);
}

TEST(SkeletonTissue, DisplacedBoneFeelsTheSummedStiffness) {
  // The tissue is at rest and one bone is displaced. The force is the summed stiffness of the bone's attachments times
  // the displacement.
  const HandModel hand = small_hand();
  State state = rest_state(hand);
  const SkeletonTissue term(hand, state.layout());
  const Vector3 shift(0.003, -0.001, 0.002);
  state.body_poses[3].position += shift;
  VectorX gradient = VectorX::Zero(state.layout().dof_count());
  term.add_gradient(state, gradient);
  EXPECT_LE((gradient.segment<3>(3 * state.layout().body_translation_block(3)) - (900 + 500 + 700) * shift).norm(),
            1e-10);
  EXPECT_NEAR(term.value(state), 0.5 * 2100 * shift.squaredNorm(), 1e-12);
}

TEST(SkeletonTissue, RefusesAStateThatIsTooSmall) {
  EXPECT_THROW(SkeletonTissue(small_hand(), DofLayout{5, 21}), std::invalid_argument);
  EXPECT_THROW(SkeletonTissue(small_hand(), DofLayout{6, 20}), std::invalid_argument);
}

}  // namespace
}  // namespace softhand::skeleton_tissue_test
