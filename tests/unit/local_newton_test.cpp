// LocalNewton moves only the blocks that the kinked terms touch, to the minimum over these blocks.
#include "solver/local_newton.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "solver/block_cholesky.hpp"
#include "support/pushed_chain.hpp"

namespace softhand::local_newton_test {
namespace {

using testing::Spring, testing::Wall;

struct Scene : testing::PushedChain {
  LocalNewton::Result minimise(VectorX& direction, int most_modes = 0) {
    hessian.set_zero();
    for (Energy* term : {&tie, &first, &second, &third}) term->add_hessian(state, hessian, Curvature::projected);
    hessian.begin_journal();
    for (Energy* term : walls()) term->add_hessian(state, hessian, Curvature::projected);
    factor.analyze(hessian);
    factor.load(hessian);
    EXPECT_TRUE(factor.factorize());
    return solver.minimise(state, walls(), Curvature::projected, gradient_at(state), hessian, false, most_modes, 1e9,
                           factor, direction);
  }
  BlockCholesky<double> factor;
  LocalNewton solver{DofLayout{4, 0}};
};

TEST(LocalNewton, MinimisesOverTouchedNodesAndMovesNoOther) {
  Scene scene;
  VectorX direction(12);
  const LocalNewton::Result result = scene.minimise(direction);
  ASSERT_TRUE(result.found);
  EXPECT_GT(result.operations, 0);
  EXPECT_EQ(direction.head(6).norm(), 0) << "nodes 0 and 1 touch nothing";
  State moved = scene.state;
  apply_increment(moved, direction);
  const VectorX before = scene.gradient_at(scene.state), after = scene.gradient_at(moved);
  EXPECT_GT(before.tail(6).lpNorm<Eigen::Infinity>(), 10);
  EXPECT_LE(after.tail(6).lpNorm<Eigen::Infinity>(), 1e-6) << "the other terms are quadratic, so this is exact";
}

// The chain has two blocks outside the walls. With the mode of all residual forces, they give way too.
TEST(LocalNewton, ModesMoveTheRest) {
  Scene scene;
  VectorX held(12), direction(12);
  ASSERT_TRUE(scene.minimise(held).found);
  const LocalNewton::Result result = scene.minimise(direction, 6);
  ASSERT_TRUE(result.found);
  EXPECT_EQ(result.modes, 2) << "one patch of touched nodes, and the rest";
  EXPECT_GT(direction.head(6).norm(), 0);
  State moved = scene.state, moved_alone = scene.state;
  apply_increment(moved, direction);
  apply_increment(moved_alone, held);
  const auto energy = [&](const State& state) {
    double sum = 0;
    for (const Energy* term : scene.all()) sum += term->value(state);
    return sum;
  };
  EXPECT_LT(energy(moved), 0.5 * energy(moved_alone));
  EXPECT_LE(scene.gradient_at(moved).tail(6).lpNorm<Eigen::Infinity>(), 1e-6);
}

TEST(LocalNewton, FindsNothingInBalance) {
  Scene scene;
  VectorX direction(12);
  ASSERT_TRUE(scene.minimise(direction).found);
  apply_increment(scene.state, direction);
  EXPECT_FALSE(scene.minimise(direction).found);
}

TEST(LocalNewton, FindsNothingWithoutContact) {
  Scene scene;
  scene.near = Wall(2, -1, 1e4);
  scene.far = Wall(3, -1, 1e4);
  for (Energy* term : scene.walls()) term->bind(scene.hessian);
  VectorX direction(12);
  scene.state.node_positions.setZero();
  EXPECT_FALSE(scene.minimise(direction).found);
}

// Nodes in a row, each tied to the origin and pushed by a wall. Springs connect each node with the next `reach` nodes.
// With `objects`, the blocks of the last nodes are those of objects, and only they may move.
LocalNewton::Result push_row(int count, int reach, double most_operations, VectorX& direction, int objects = 0) {
  std::vector<std::unique_ptr<Energy>> springs, walls;
  for (int n = 0; n < count; ++n) {
    springs.push_back(std::make_unique<Spring>(n, -1, 100));
    for (int other = n + 1; other < std::min(count, n + reach + 1); ++other)
      springs.push_back(std::make_unique<Spring>(n, other, 1));
    walls.push_back(std::make_unique<Wall>(n, 0.01, 1e4));
  }
  State state;
  state.node_positions = state.node_velocities = Eigen::Matrix3Xd::Zero(3, count);
  BlockPattern pattern(count, objects);
  for (const auto* terms : {&springs, &walls})
    for (const auto& term : *terms) term->add_pattern(pattern);
  BlockMatrix hessian(pattern);
  VectorX gradient = VectorX::Zero(3 * count);
  for (const auto* terms : {&springs, &walls}) {
    for (const auto& term : *terms) {
      term->bind(hessian);
      term->add_gradient(state, gradient);
    }
  }
  hessian.set_zero();
  for (const auto& term : springs) term->add_hessian(state, hessian, Curvature::projected);
  hessian.begin_journal();
  std::vector<Energy*> kinked;
  for (const auto& term : walls) {
    term->add_hessian(state, hessian, Curvature::projected);
    kinked.push_back(term.get());
  }
  LocalNewton solver(DofLayout{count, 0});
  BlockCholesky<double> factor;
  direction = VectorX::Zero(3 * count);
  return solver.minimise(state, kinked, Curvature::projected, gradient, hessian, objects > 0, 0, most_operations,
                         factor, direction);
}

// A step of a power grasp that was cut off touches with 200 nodes. Before, more than 128 were refused.
TEST(LocalNewton, MovesAllTouchedNodesOfAPowerGrasp) {
  VectorX direction;
  ASSERT_TRUE(push_row(200, 1, 1e6, direction).found);
  for (int n = 0; n < 200; ++n) EXPECT_NEAR(direction[3 * n], 1e4 * 0.01 / (1e4 + 100), 1e-9);
  EXPECT_FALSE(push_row(LocalNewton::kMaxBlocks + 1, 1, 1e6, direction).found);
}

TEST(LocalNewton, MovesOnlyObjectsOnRequest) {
  VectorX direction;
  ASSERT_TRUE(push_row(6, 0, 1e6, direction, 2).found);
  EXPECT_EQ(direction.head(12).norm(), 0);
  for (int n = 4; n < 6; ++n) EXPECT_NEAR(direction[3 * n], 1e4 * 0.01 / (1e4 + 100), 1e-9);
}

// The factor of nodes that are all coupled with each other costs more than the tissue.
TEST(LocalNewton, RefusesAFactorThatCostsTooMuch) {
  VectorX direction;
  EXPECT_FALSE(push_row(100, 100, 1e6, direction).found);
  EXPECT_TRUE(push_row(100, 100, 1e7, direction).found);
}

}  // namespace
}  // namespace softhand::local_newton_test
