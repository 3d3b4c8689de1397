// Forward kinematics of the hand, and the solver that finds a posture.
#include "trackers/replay/posture_solver.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "unit/opposing_hand.hpp"

namespace softhand::posture_solver_test {
namespace {

using testing::opposing_hand;
using testing::pad;

TEST(Kinematics, RestAnglesGiveTheRestPoseAndFlexionBendsTowardsThePalm) {
  const HandModel hand = opposing_hand();
  JointAngles angles;
  angles.fill(Vector3::Zero());
  const Pose wrist{Vector3(1, 2, 3), rotation_exp(Vector3(0.3, -0.2, 0.5))};
  const JointFrames rest = forward_kinematics(hand, wrist, angles);
  for (std::size_t j = 0; j < kJointCount; ++j) {
    EXPECT_LT((rest[j].position - wrist * hand.rest_joints[j].position).norm(), 1e-12) << kJointNames[j];
  }
  angles[slot_of(Body::index_proximal)].x() = -1;
  const JointFrames bent = forward_kinematics(hand, Pose{}, angles);
  EXPECT_LT(bent[slot_of(Joint::index_tip)].position.y(),
            hand.rest_joints[slot_of(Joint::index_tip)].position.y() - 0.05);
  for (std::size_t j = 6; j < kJointCount; ++j) {
    const Body body = body_of(static_cast<Joint>(j));
    if (joint_of(body) != static_cast<Joint>(j)) continue;
    const std::size_t parent = slot_of(joint_of(parent_of(body)));
    EXPECT_NEAR((bent[j].position - bent[parent].position).norm(),
                (hand.rest_joints[j].position - hand.rest_joints[parent].position).norm(), 1e-12);
  }
}

void expect_correct_derivative(PostureSolver& solver, const PostureSolver::Goals& goals, std::size_t name) {
  VectorX values = solver.values(), gradient, unused;
  for (Eigen::Index i = 0; i < values.size(); ++i) values[i] += 0.1 * std::sin(1.0 + 3.0 * static_cast<double>(i));
  EXPECT_GT(solver.evaluate(values, goals, gradient), 1e-4) << name;
  for (Eigen::Index i = 0; i < values.size(); ++i) {
    constexpr double kStep = 1e-6;
    VectorX up = values, down = values;
    up[i] += kStep;
    down[i] -= kStep;
    const double slope = (solver.evaluate(up, goals, unused) - solver.evaluate(down, goals, unused)) / (2 * kStep);
    EXPECT_NEAR(gradient[i], slope, 1e-5 * (1 + gradient.norm())) << "goal " << name << " value " << i;
  }
}

TEST(PostureSolver, EveryGoalHasACorrectDerivative) {
  const HandModel hand = opposing_hand();
  const GripHand grip(hand);
  JointAngles bent, straight;
  bent.fill(Vector3(-0.3, 0.1, 0));
  straight.fill(Vector3::Zero());
  PostureSolver solver(grip, Pose{Vector3(0.02, 0.05, 0.1), rotation_exp(Vector3(0.4, -0.2, 0.3))},
                       {grip.limited(bent), straight});
  solver.free_wrist();
  for (const Finger f : {Finger::thumb, Finger::index}) solver.free_finger(f, {0});
  solver.free_finger(Finger::middle, {0, 1});
  const std::array<PostureSolver::Goals, 5> goals{
      [](PostureSolver& s) {
        for (const std::size_t posture : {0u, 1u}) {
          const auto pad = s.pad(Finger::middle, posture);
          s.add_point_goal(20, posture, pad.body, pad.position, Vector3(0.1, 0.2, 0.3));
        }
      },
      [](PostureSolver& s) {
        const auto pad = s.pad(Finger::thumb, 0);
        s.add_direction_goal(2, 0, pad.body, pad.normal, Vector3(0.6, 0, 0.8));
      },
      [](PostureSolver& s) {
        const auto thumb = s.pad(Finger::thumb, 0), index = s.pad(Finger::index, 0);
        const Vector3 between = index.position - thumb.position, axis = between.normalized();
        s.add_residual(3, between.norm() - 0.01,
                       {by_point(0, index.body, index.position, axis), by_point(0, thumb.body, thumb.position, -axis)});
      },
      [](PostureSolver& s) {
        s.add_distance_goal(0, {Finger::index, Finger::middle}, 0.07);
      },
      [](PostureSolver& s) {
        s.add_start_goal(1.5);
        s.add_wrist_rotation_goal(3);
      }};
  for (std::size_t g = 0; g < goals.size(); ++g) expect_correct_derivative(solver, goals[g], g);
}

TEST(PostureSolver, TheGoalOfATouchHasACorrectDerivativeAlsoWhereThePadRolls) {
  const HandModel hand = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json");
  const GripHand grip(hand);
  PostureSolver solver(grip, Pose{Vector3(0.02, 0.05, 0.1), rotation_exp(Vector3(0.4, -0.2, 0.3))}, {grip.open()});
  solver.free_wrist();
  solver.free_finger(Finger::index, {0});
  expect_correct_derivative(
      solver,
      [](PostureSolver& s) {
        const auto pad = s.pad(Finger::index, 0);
        s.add_touch_goal(20, 0, pad.touch(Vector3(0.6, -0.8, 0)), Vector3(0.1, 0.2, 0.3));
      },
      0);
}

}  // namespace
}  // namespace softhand::posture_solver_test
