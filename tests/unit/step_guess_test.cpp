// The guess of a step's end: a rigid movement of all targets, bent fingers, touching bones, held objects.
#include "scene/step_guess.hpp"

#include <gtest/gtest.h>

#include "energies/joint.hpp"
#include "math/rotation.hpp"
#include "support/block_hand.hpp"

namespace softhand::step_guess_test {
namespace {

constexpr double kStep = 1.0 / 90;
constexpr int kObject = kBodyCount;  // a free body after the bones

// The block hand at rest, and its couplings after one step at these targets.
struct Hand {
  Hand()
      : model(testing::block_hand(1)),
        state(empty_state({model.node_count(), kBodyCount + 1})),
        coupling("coupling", sites(), state.layout()),
        links(kBodyCount) {
    for (int b = 0; b < kBodyCount; ++b)
      state.body_poses[static_cast<std::size_t>(b)] = model.body_rest_pose(static_cast<Body>(b));
    for (int n = 0; n < model.node_count(); ++n) {
      state.node_positions.col(n) = model.nodes[static_cast<std::size_t>(n)];
      node_bones.push_back(n % kBodyCount);
    }
    state.body_poses[kObject].position = Vector3(0.05, 0.02, 0.1);
    state.body_velocities[kObject].linear = Vector3(0.9, 0, 0);
    for (const JointSite& joint : hand_joints(model))
      links[static_cast<std::size_t>(joint.child)] = {joint.parent, joint.child_from_joint.position};
    linkage = std::make_unique<Linkage>(state.layout(), links, node_bones);
    guess = StepGuess(links, node_bones);
    targets = state.body_poses;
    aim();
    coupling.begin_step(state, kStep);
    coupling.end_step(state);
  }
  static std::vector<CouplingSite> sites() {
    std::vector<CouplingSite> list;
    for (int b = 0; b < kBodyCount; ++b) list.push_back({b, Pose{}, {500, 0.5, 0, 0}});
    return list;
  }
  void aim() {
    for (int b = 0; b < kBodyCount; ++b) coupling.set_target(b, targets[static_cast<std::size_t>(b)], {});
  }
  // The guess for these targets.
  State guessed() {
    aim();
    coupling.begin_step(state, kStep);
    State end = state;
    guess.begin(end);
    guess.move_bones(coupling, 0, *linkage, end);
    guess.move_nodes(end, kStep);
    return end;
  }
  double joint_gap(const State& end, int bone) const {
    const auto child = static_cast<std::size_t>(bone), parent = static_cast<std::size_t>(links[child].parent);
    const Vector3 joint = state.body_poses[child] * links[child].joint;
    const Vector3 in_parent = state.body_poses[parent].inverse() * joint;
    return (end.body_poses[child] * links[child].joint - end.body_poses[parent] * in_parent).norm();
  }
  HandModel model;
  State state;
  BodyCoupling coupling;
  std::vector<Linkage::Link> links;
  std::vector<std::int32_t> node_bones;
  std::unique_ptr<Linkage> linkage;
  StepGuess guess;
  std::vector<Pose> targets;
};

TEST(StepGuess, FollowsARigidMovementOfAllTargets) {
  Hand hand;
  const Pose motion{Vector3(0.01, -0.003, 0.002), rotation_exp(Vector3(0.1, 0.2, -0.05))};
  for (Pose& target : hand.targets) target = motion * target;
  const State end = hand.guessed();
  double farthest = 0;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Pose expected = motion * hand.state.body_poses[b];
    EXPECT_LE((end.body_poses[b].position - expected.position).norm(), 1e-12) << b;
    EXPECT_LE(rotation_log(end.body_poses[b].orientation * expected.orientation.conjugate()).norm(), 1e-12) << b;
    farthest = std::max(farthest, (expected.position - hand.state.body_poses[b].position).norm());
  }
  for (Eigen::Index n = 0; n < end.node_positions.cols(); ++n)
    EXPECT_LE((end.node_positions.col(n) - motion * Vector3(hand.state.node_positions.col(n))).norm(), 1e-12) << n;
  EXPECT_NEAR(hand.guess.farthest(), farthest, 1e-12);
}

// Only rotations are taken from the targets of fingers, so targets that come apart open no joint.
TEST(StepGuess, KeepsJointsClosedWhileAFingerBends) {
  Hand hand;
  const auto bone = static_cast<std::size_t>(index_of(Body::index_intermediate));
  const Quaternion bend = rotation_exp(Vector3(0.3, 0, 0));
  hand.targets[bone] = {hand.targets[bone].position + Vector3(0.02, 0, 0), bend * hand.targets[bone].orientation};
  const State end = hand.guessed();
  EXPECT_LE(
      rotation_log(end.body_poses[bone].orientation * (bend * hand.state.body_poses[bone].orientation).conjugate())
          .norm(),
      1e-12);
  for (int b = index_of(Body::carpus) + 1; b < kBodyCount; ++b) EXPECT_LE(hand.joint_gap(end, b), 1e-12) << b;
}

TEST(StepGuess, TouchingFingersMoveWithThePalmAndCarryTheObject) {
  Hand hand;
  const int tip = index_of(Body::index_distal);
  hand.linkage->set_touching(tip);
  const Vector3 way(0.004, 0, 0.001);
  for (Pose& target : hand.targets) target.position += way;
  const auto place = static_cast<std::size_t>(tip);
  hand.targets[place].orientation = rotation_exp(Vector3(0.4, 0, 0)) * hand.targets[place].orientation;
  State end = hand.guessed();
  EXPECT_LE((end.body_poses[place].position - hand.state.body_poses[place].position - way).norm(), 1e-12);
  hand.guess.begin_object();
  hand.guess.touch(tip, end, kObject);  // node `tip` is on that bone
  hand.guess.move_object(end, kObject, kStep);
  EXPECT_LE((end.body_poses[kObject].position - hand.state.body_poses[kObject].position - way).norm(), 1e-12);

  hand.guess.begin_object();
  State free = hand.state;
  hand.guess.move_object(free, kObject, kStep);
  EXPECT_NEAR(free.body_poses[kObject].position.x() - hand.state.body_poses[kObject].position.x(), 0.01, 1e-12)
      << "an object that nothing touches keeps its velocity";
}

TEST(StepGuess, DoesNothingAfterAJump) {
  Hand hand;
  for (Pose& target : hand.targets) target = {target.position, rotation_exp(Vector3(0, 3, 0)) * target.orientation};
  hand.guessed();
  EXPECT_EQ(hand.guess.farthest(), 0);
}

}  // namespace
}  // namespace softhand::step_guess_test
