// Joints of eq. 20: derivatives of every kind, balance, rest, limits and pendulums.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "energies/dense_step.hpp"
#include "energies/inertia.hpp"
#include "energies/joint.hpp"
#include "support/block_hand.hpp"

namespace softhand::skeleton_joint_test {
namespace {

using testing::DenseStepper;

JointModel joint_model(JointKind kind) {
  JointModel model;
  model.kind = kind;
  model.position_stiffness = 1e3;
  model.orientation_stiffness = 10;
  model.limit_stiffness = 3;
  model.flexion_range = {-1.6, 0.2};
  model.abduction_range = {-0.3, 0.4};
  return model;
}

// Parent 0 and child 1. Their joint is away from both centres and has its own axes.
JointSite site_of(JointKind kind) {
  return {0,
          1,
          {Vector3(0, 0.01, -0.03), rotation_exp(Vector3(0.2, 0.1, 0))},
          {Vector3(0.002, 0, 0.02), rotation_exp(Vector3(0, 0.3, 0.1))},
          joint_model(kind)};
}

// The child is placed so that the joint is closed and has the given angles.
State posed(const JointSite& site, const Vector3& angles, std::uint64_t seed = 2) {
  State state = testing::random_state({1, 2}, seed);
  state.body_poses[1] = state.body_poses[0] * site.parent_from_joint * Pose{Vector3::Zero(), rotation_exp(angles)} *
                        site.child_from_joint.inverse();
  return state;
}

State resting_hand(const HandModel& hand) {
  State state;
  state.node_positions.resize(3, 0);
  state.node_velocities.resize(3, 0);
  for (int b = 0; b < kBodyCount; ++b) {
    state.body_poses.push_back(hand.body_rest_pose(static_cast<Body>(b)));
    state.body_velocities.emplace_back();
  }
  return state;
}

class EveryKind : public ::testing::TestWithParam<JointKind> {};

TEST_P(EveryKind, DerivativesAndBalanceAndRigidMotion) {
  const JointSite site = site_of(GetParam());
  JointEnergy joint({site}, {1, 2});
  // Angles inside the range, outside it on either side, large ones, and almost half a turn.
  for (const Vector3& angles :
       {Vector3(-0.5, 0.1, 0.05), Vector3(0.6, 0.7, -0.2), Vector3(-2.0, -0.9, 0.3), Vector3(1.8, -2.2, 0.8)}) {
    const State state = testing::perturbed(posed(site, angles), 7, 0.004, 0.02);
    testing::check_term(joint, state, 0.01);
    testing::check_balance(joint, state);
    testing::check_rigid_motion(joint, state, {Vector3(1, -2, 0.5), rotation_exp(Vector3(2, 1, -1))});
  }
}

TEST_P(EveryKind, ReturnsTheGivenAnglesAndNoEnergyAtRest) {
  const JointSite site = site_of(GetParam());
  const JointEnergy joint({site}, {1, 2});
  const Vector3 angles(-0.4, 0.2, 0.1);
  EXPECT_LE((joint.angles(0, posed(site, angles)) - angles).norm(), 1e-14);
  const State rest = posed(site, Vector3::Zero());
  VectorX gradient = VectorX::Zero(rest.layout().dof_count());
  joint.add_gradient(rest, gradient);
  EXPECT_LE(gradient.norm(), 1e-12);
  EXPECT_LE(joint.value(rest), 1e-25);
}

INSTANTIATE_TEST_SUITE_P(JointEnergy, EveryKind,
                         ::testing::Values(JointKind::ball, JointKind::saddle, JointKind::hinge));

constexpr double kRamp = 0.02;  // rad; the stiffness of a limit grows over it

// Energy of a limit that is exceeded by more than the ramp.
double limit_energy(double stiffness, double excess) {
  return stiffness * (0.5 * excess * excess - kRamp * kRamp / 12);
}

TEST(JointEnergy, EachKindLeavesItsOwnAxesFree) {
  const auto cost = [](JointKind kind, const Vector3& angles) {
    const JointSite site = site_of(kind);
    return JointEnergy({site}, {1, 2}).value(posed(site, angles));
  };
  const Vector3 flexed(-1, 0, 0), abducted(0, 0.2, 0), twisted(0, 0, 0.1);
  EXPECT_NEAR(cost(JointKind::ball, flexed), 0.5 * 10, 1e-12);
  EXPECT_NEAR(cost(JointKind::saddle, flexed), 0, 1e-12);
  EXPECT_NEAR(cost(JointKind::hinge, flexed), 0, 1e-12);
  EXPECT_NEAR(cost(JointKind::saddle, abducted), 0, 1e-12);
  EXPECT_NEAR(cost(JointKind::hinge, abducted), 0.5 * 10 * 0.04, 1e-12);
  EXPECT_NEAR(cost(JointKind::saddle, twisted), 0.5 * 10 * 0.01, 1e-12);
  EXPECT_NEAR(cost(JointKind::hinge, Vector3(-1.8, 0, 0)), limit_energy(3, 0.2), 1e-12);
  EXPECT_NEAR(cost(JointKind::hinge, Vector3(0.5, 0, 0)), limit_energy(3, 0.3), 1e-12);
  EXPECT_NEAR(cost(JointKind::saddle, Vector3(0, -0.5, 0)), limit_energy(3, 0.2), 1e-12);
}

TEST(JointEnergy, FiniteAtHalfATurn) {
  const JointSite site = site_of(JointKind::ball);
  JointEnergy joint({site}, {1, 2});
  for (const double angle : {M_PI - 1e-12, M_PI, M_PI + 1e-12}) {
    const State state = posed(site, angle * Vector3(0.6, 0, 0.8));
    VectorX gradient = VectorX::Zero(state.layout().dof_count());
    BlockMatrix matrix = testing::bound_matrix(joint, state);
    EXPECT_TRUE(std::isfinite(joint.add_all(state, gradient, matrix, Curvature::exact)));
    EXPECT_TRUE(gradient.allFinite() && matrix.dense().allFinite());
  }
}

TEST(JointEnergy, WholeHandRestsAndBalances) {
  const HandModel hand = testing::block_hand();
  State state = resting_hand(hand);
  JointEnergy joints(hand_joints(hand), state.layout());
  EXPECT_EQ(joints.joint_count(), 20);
  VectorX gradient = VectorX::Zero(state.layout().dof_count());
  joints.add_gradient(state, gradient);
  EXPECT_LE(gradient.norm(), 1e-9);
  state = testing::perturbed(state, 5, 0.01, 0.4);
  testing::check_balance(joints, state);
  testing::check_term(joints, state, 0.01);
}

TEST(JointEnergy, ExcessBeyondALimitIsTorqueOverStiffness) {
  // The angle exceeds the range by torque / k (excess +-2 %). The torque comes from the child's own gravity on an arm,
  // because a couple of two opposite forces is not available. The joint is at the held parent's centre.
  JointSite site{0, 1, Pose{}, {Vector3(0, 0, 0.02), Quaternion::Identity()}, joint_model(JointKind::hinge)};
  site.model.position_stiffness = 1e7;
  site.model.limit_stiffness = 50;
  State state = posed(site, Vector3::Zero());
  state.body_poses[0] = Pose{};
  state.body_poses[1] = Pose{} * site.child_from_joint.inverse();  // 20 mm along -Z
  state.body_velocities.assign(2, Twist{});
  state.node_velocities.setZero();
  Inertia inertia({1.0}, 2);
  inertia.set_dynamic(1, 10.0, 1e-3 * Matrix3::Identity(), Vector3(0, 9.81, 0));  // this gravity lifts: extension, +x
  JointEnergy joint({site}, state.layout());
  DenseStepper stepper({&inertia, &joint}, state);
  for (int i = 0; i < 2000; ++i) stepper.step(state, 0.1);
  const double angle = joint.angles(0, state).x();
  const double torque = 10.0 * 9.81 * 0.02 * std::cos(angle);
  EXPECT_NEAR(angle - 0.2, torque / 50, 0.02 * torque / 50);
}

// The second difference of the energy changes little from one sample to the next, so that a joint that trembles at its
// limit does not make a factor stale. A jump would be as large as the limit's whole stiffness.
TEST(JointEnergy, StiffnessOfALimitDoesNotJump) {
  JointSite site = site_of(JointKind::hinge);
  const auto cost = [&](double angle) {
    const State state = posed(site, Vector3(angle, 0, 0));
    return JointEnergy({site}, state.layout()).value(state);
  };
  const double maximum = site.model.flexion_range[1], step = 5e-4;
  double last = 0;
  for (double angle = maximum - 0.01; angle < maximum + 1.5 * kRamp; angle += step) {
    const double stiffness = (cost(angle + step) - 2 * cost(angle) + cost(angle - step)) / (step * step);
    EXPECT_LE(std::abs(stiffness - last), 0.12 * site.model.limit_stiffness) << "at " << angle;
    last = stiffness;
  }
  EXPECT_NEAR(last, site.model.limit_stiffness, 0.01 * site.model.limit_stiffness);
}

TEST(JointEnergy, RefusesBadRangesAndStiffness) {
  JointSite site = site_of(JointKind::hinge);
  site.model.flexion_range = {0.1, 0.2};
  EXPECT_THROW(JointEnergy({site}, {0, 2}), std::invalid_argument);
  site = site_of(JointKind::hinge);
  site.model.flexion_range = {0.1, -0.1};
  EXPECT_THROW(JointEnergy({site}, {0, 2}), std::invalid_argument);
  site = site_of(JointKind::hinge);
  site.model.position_stiffness = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(JointEnergy({site}, {0, 2}), std::invalid_argument);
}

}  // namespace
}  // namespace softhand::skeleton_joint_test
