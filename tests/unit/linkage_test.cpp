// Linkage rotates increments with their bodies. Tests a rigid turn of all bodies, stiff joints, and the transpose.
#include "solver/linkage.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "math/rotation.hpp"
#include "support/box_mesh.hpp"

namespace softhand::linkage_test {
namespace {

constexpr int kNodes = 5;

// A chain of three bodies and one separate body. All nodes are on the chain.
struct Chain {
  Chain()
      : linkage({kNodes, 4}, {Linkage::Link{}, {0, Vector3(0, 0, 0.02)}, {1, Vector3(0.001, 0, 0.015)}},
                {0, 1, 2, 2, 1}) {
    state.node_positions = state.node_velocities = Eigen::Matrix3Xd::Zero(3, kNodes);
    state.body_poses.resize(4);
    state.body_velocities.resize(4);
    for (Pose& pose : state.body_poses) pose.orientation = rotation_exp(random.vector());
    linkage.set_earlier_state(state);
  }
  VectorX increment() {
    VectorX x(3 * (kNodes + 8));
    for (Eigen::Index i = 0; i < x.size(); i += 3) x.segment<3>(i) = random.vector();
    return x;
  }
  testing::Random random{3};
  Linkage linkage;
  State state;
};

Vector3 joint_gap(const VectorX& x, const State& state, int parent, int child, const Vector3& in_child,
                  const Vector3& in_parent) {
  const auto at = [&](int body, const Vector3& local) {
    const auto first = 3 * (kNodes + 2 * body);
    const Vector3 arm = state.body_poses[static_cast<std::size_t>(body)].orientation * local;
    return Vector3(x.segment<3>(first) + Vector3(x.segment<3>(first + 3)).cross(arm));
  };
  return at(child, in_child) - at(parent, in_parent);
}

TEST(Linkage, KeepsIncrementsIfNoBodyTurned) {
  Chain chain;
  chain.linkage.set_later_state(chain.state);
  const VectorX before = chain.increment();
  VectorX x = before;
  chain.linkage.to_now(x);
  EXPECT_LE((x - before).lpNorm<Eigen::Infinity>(), 1e-14);
  chain.linkage.to_then(x);
  EXPECT_LE((x - before).lpNorm<Eigen::Infinity>(), 1e-14);
}

TEST(Linkage, RigidTurnRotatesAllIncrements) {
  Chain chain;
  const Quaternion turn = rotation_exp(Vector3(0.5, -1, 0.3));
  for (Pose& pose : chain.state.body_poses) pose.orientation = turn * pose.orientation;
  chain.linkage.set_later_state(chain.state);
  const VectorX before = chain.increment();
  VectorX x = before;
  chain.linkage.to_now(x);
  for (Eigen::Index i = 0; i < x.size(); i += 3)
    EXPECT_LE((x.segment<3>(i) - turn * Vector3(before.segment<3>(i))).norm(), 1e-14) << i;
}

TEST(Linkage, KeepsJointGapsForAnyTurnOfTheBodies) {
  Chain chain;
  const Vector3 in_child(0, 0, 0.02), in_parent(0, 0.001, -0.03);
  VectorX x = chain.increment();
  const Vector3 gap_then = joint_gap(x, chain.state, 0, 1, in_child, in_parent);
  ASSERT_GT(gap_then.norm(), 0.1);
  Quaternion turn_of_parent;
  for (std::size_t b = 0; b < 4; ++b) {
    const Quaternion turn = rotation_exp(chain.random.vector());
    if (b == 0) turn_of_parent = turn;
    chain.state.body_poses[b].orientation = turn * chain.state.body_poses[b].orientation;
  }
  chain.linkage.set_later_state(chain.state);
  VectorX now = x;
  chain.linkage.to_now(now);
  const Vector3 gap_now = joint_gap(now, chain.state, 0, 1, in_child, in_parent);
  EXPECT_LE((gap_now - turn_of_parent * gap_then).norm(), 1e-14);
}

TEST(Linkage, ToThenIsTheTransposeOfToNow) {
  Chain chain;
  for (Pose& pose : chain.state.body_poses) pose.orientation = rotation_exp(chain.random.vector()) * pose.orientation;
  chain.linkage.set_later_state(chain.state);
  const VectorX x = chain.increment(), g = chain.increment();
  VectorX now = x, then = g;
  chain.linkage.to_now(now);
  chain.linkage.to_then(then);
  ASSERT_GT((now - x).norm(), 1);
  EXPECT_NEAR(g.dot(now), then.dot(x), 1e-12);
}

// Each body of the chain moves on its own screw. The nodes are at rest on their bodies, except one node. The separate
// body stays.
TEST(Linkage, CoastMovesLinkedBodiesWithTheirNodes) {
  constexpr double kStep = 0.01;
  Chain chain;
  for (Eigen::Index n = 0; n < kNodes; ++n) chain.state.node_positions.col(n) = chain.random.vector();
  const std::array<std::size_t, kNodes> carrier{0, 1, 2, 2, 1};
  for (std::size_t b = 0; b < 4; ++b) {
    chain.state.body_poses[b].position = chain.random.vector();
    chain.state.body_velocities[b] = {10 * chain.random.vector(), 30 * chain.random.vector()};
  }
  for (std::size_t n = 0; n < kNodes; ++n) {
    const auto column = static_cast<Eigen::Index>(n);
    const Twist& velocity = chain.state.body_velocities[carrier[n]];
    chain.state.node_velocities.col(column) =
        velocity.linear +
        velocity.angular.cross(chain.state.node_positions.col(column) - chain.state.body_poses[carrier[n]].position);
  }
  const Vector3 own(0.3, 0.1, -0.2);
  chain.state.node_velocities.col(4) += own;
  const State start = chain.state;
  chain.linkage.coast(chain.state, kStep);
  for (std::size_t n = 0; n < kNodes; ++n) {
    const auto column = static_cast<Eigen::Index>(n);
    const Pose &before = start.body_poses[carrier[n]], &after = chain.state.body_poses[carrier[n]];
    const Vector3 moved = after.inverse() * Vector3(chain.state.node_positions.col(column)) -
                          before.inverse() * Vector3(start.node_positions.col(column));
    EXPECT_LE(
        (moved - before.orientation.conjugate() * Vector3(n == 4 ? Vector3(kStep * own) : Vector3::Zero())).norm(),
        1e-13)
        << n;
    EXPECT_GE((after.position - before.position).norm(), 0.01);
  }
  EXPECT_EQ(chain.state.body_poses[3].position, start.body_poses[3].position);

  const VectorX world = chain.increment();
  VectorX x = world;
  chain.linkage.to_bodies(chain.state, x);
  EXPECT_LE((chain.state.body_poses[2].orientation * Vector3(x.segment<3>(6)) - world.segment<3>(6)).norm(), 1e-14);
  EXPECT_EQ(x.tail(24), world.tail(24));
  chain.linkage.to_world(chain.state, x);
  EXPECT_LE((x - world).lpNorm<Eigen::Infinity>(), 1e-14);
}

// Node 1 belongs to no body. The body of node 0 turns.
TEST(Linkage, NodesWithoutABodyMoveStraight) {
  testing::Random random(5);
  Linkage linkage({2, 1}, {Linkage::Link{}}, {0, -1});
  State state = empty_state({2, 1});
  state.node_positions.col(0) = Vector3(0.01, 0, 0);
  state.node_positions.col(1) = Vector3(0.02, 0, 0);
  linkage.set_earlier_state(state);
  state.body_poses[0].orientation = rotation_exp(Vector3(0, 0, 1));
  linkage.set_later_state(state);
  VectorX x(12);
  for (Eigen::Index i = 0; i < x.size(); i += 3) x.segment<3>(i) = random.vector();
  const VectorX before = x;
  linkage.to_now(x);
  EXPECT_EQ(x.segment<3>(3), before.segment<3>(3));
  EXPECT_NE(x.segment<3>(0), before.segment<3>(0));
  x = before;
  linkage.to_then(x);
  EXPECT_EQ(x.segment<3>(3), before.segment<3>(3));
  x = before;
  linkage.to_bodies(state, x);
  EXPECT_EQ(x.segment<3>(3), before.segment<3>(3));
  const Vector3 start = state.node_positions.col(1);
  linkage.move(state, before, 0.5);
  EXPECT_LE((state.node_positions.col(1) - start - 0.5 * before.segment<3>(3)).norm(), 1e-15);
  EXPECT_EQ(linkage.tangent().segment<3>(3), before.segment<3>(3));
  state.node_velocities.col(1) = Vector3(1, 2, 3);
  const Vector3 moved = state.node_positions.col(1);
  linkage.coast(state, 0.1);
  EXPECT_LE((state.node_positions.col(1) - moved - Vector3(0.1, 0.2, 0.3)).norm(), 1e-15);
  linkage.clear_touching();
  EXPECT_FALSE(linkage.any_touching());
  linkage.set_loose_touching();
  EXPECT_TRUE(linkage.any_touching());
}

TEST(Linkage, RefusesIndicesOutOfRange) {
  EXPECT_THROW(Linkage({1, 1}, {{0, Vector3::Zero()}}, {0}), std::invalid_argument);
  EXPECT_THROW(Linkage({1, 1}, {Linkage::Link{}, Linkage::Link{}}, {0}), std::invalid_argument);
  EXPECT_THROW(Linkage({1, 1}, {Linkage::Link{}}, {1}), std::invalid_argument);
  EXPECT_THROW(Linkage({1, 1}, {Linkage::Link{}}, {}), std::invalid_argument);
}

void place(Chain& chain) {
  for (int n = 0; n < kNodes; ++n) chain.state.node_positions.col(n) = 0.05 * chain.random.vector();
  for (Pose& pose : chain.state.body_poses) pose.position = 0.05 * chain.random.vector();
}

double distance(const State& a, const State& b) {
  double largest = (a.node_positions - b.node_positions).cwiseAbs().maxCoeff();
  for (std::size_t k = 0; k < a.body_poses.size(); ++k) {
    largest = std::max(largest, (a.body_poses[k].position - b.body_poses[k].position).norm());
    largest =
        std::max(largest, rotation_log(a.body_poses[k].orientation * b.body_poses[k].orientation.conjugate()).norm());
  }
  return largest;
}

TEST(Linkage, MoveIsTheIncrementToFirstOrder) {
  Chain chain;
  place(chain);
  const VectorX x = chain.increment();
  double before = 0;
  for (const double scale : {1e-2, 1e-3, 1e-4}) {
    State along = chain.state, straight = chain.state;
    chain.linkage.move(along, x, scale);
    apply_increment(straight, x, scale);
    const double apart = distance(along, straight);
    if (before > 0) {
      EXPECT_LT(apart, 0.02 * before) << "the difference must fall with the square of the scale";
    }
    before = apart;
  }
  State still = chain.state;
  chain.linkage.move(still, x, 0);
  EXPECT_LE((chain.linkage.tangent() - x).lpNorm<Eigen::Infinity>(), 1e-14);
}

TEST(Linkage, TangentIsTheDerivativeOfTheMove) {
  Chain chain;
  place(chain);
  const VectorX x = chain.increment();
  constexpr double kScale = 0.7, kStep = 1e-6;
  State ahead = chain.state, there = chain.state;
  chain.linkage.move(ahead, x, kScale + kStep);
  chain.linkage.move(there, x, kScale);
  State expected = there;
  apply_increment(expected, chain.linkage.tangent(), kStep);
  EXPECT_LE(distance(ahead, expected), 1e-10);
}

// An increment that turns a body with its nodes by 1 rad changes no distance between them.
TEST(Linkage, MoveTurnsCarriedNodesWithoutStretch) {
  Chain chain;
  place(chain);
  const Vector3 turn(0.4, -0.8, 0.45);
  VectorX x = VectorX::Zero(3 * (kNodes + 8));
  const Vector3 pivot = chain.state.body_poses[0].position;
  for (int n = 0; n < kNodes; ++n) x.segment<3>(3 * n) = turn.cross(Vector3(chain.state.node_positions.col(n)) - pivot);
  for (int body = 0; body < 3; ++body) {
    x.segment<3>(3 * (kNodes + 2 * body)) =
        turn.cross(chain.state.body_poses[static_cast<std::size_t>(body)].position - pivot);
    x.segment<3>(3 * (kNodes + 2 * body) + 3) = turn;
  }
  State moved = chain.state;
  chain.linkage.move(moved, x, 1);
  for (int a = 0; a < kNodes; ++a) {
    for (int b = 0; b < a; ++b) {
      EXPECT_NEAR((moved.node_positions.col(a) - moved.node_positions.col(b)).norm(),
                  (chain.state.node_positions.col(a) - chain.state.node_positions.col(b)).norm(), 1e-14);
    }
  }
  apply_increment(chain.state, x, 1);
  EXPECT_GT(distance(moved, chain.state), 1e-3) << "straight lines stretch: this shows nothing otherwise";
}

TEST(Linkage, MovesTouchingBodiesAndTheirParentsStraight) {
  Chain chain;
  place(chain);
  const VectorX x = chain.increment();
  State along = chain.state, straight = chain.state;
  chain.linkage.set_touching(2);  // 2 hangs on 1, and 1 on 0
  EXPECT_TRUE(chain.linkage.any_touching());
  chain.linkage.move(along, x, 0.5);
  apply_increment(straight, x, 0.5);
  EXPECT_LE(distance(along, straight), 1e-14);
  chain.linkage.clear_touching();
  EXPECT_FALSE(chain.linkage.any_touching());
  along = chain.state;
  chain.linkage.move(along, x, 0.5);
  EXPECT_GT(distance(along, straight), 1e-3);
}

}  // namespace
}  // namespace softhand::linkage_test
