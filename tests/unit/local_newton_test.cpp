// LocalNewton moves only the blocks that the kinked terms touch, to the minimum over these blocks.
#include "solver/local_newton.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "solver/block_cholesky.hpp"

namespace softhand {
namespace {

// A quadratic term 1/2 k |x_a - x_b|^2 between two nodes, or between a node and the origin.
class Spring final : public Energy {
 public:
  Spring(int a, int b, double stiffness) : a_(a), b_(b), stiffness_(stiffness) {}
  std::string_view name() const override { return "spring"; }
  void add_pattern(BlockPattern& pattern) const override {
    pattern.add(a_, a_);
    if (b_ < 0) return;
    pattern.add(b_, b_);
    pattern.add(a_, b_);
  }
  void bind(const BlockMatrix& matrix) override {
    aa_ = matrix.find(a_, a_);
    if (b_ < 0) return;
    bb_ = matrix.find(b_, b_);
    ab_ = matrix.find(a_, b_);
  }
  double value(const State& state) const override { return 0.5 * stiffness_ * stretch(state).squaredNorm(); }
  double add_gradient(const State& state, VectorX& gradient) const override {
    const Vector3 force = stiffness_ * stretch(state);
    gradient.segment<3>(3 * a_) += force;
    if (b_ >= 0) gradient.segment<3>(3 * b_) -= force;
    return value(state);
  }
  void add_hessian(const State&, BlockMatrix& hessian, Curvature) const override {
    const Matrix3 block = stiffness_ * Matrix3::Identity();
    hessian.add(aa_, block);
    if (b_ < 0) return;
    hessian.add(bb_, block);
    hessian.add(ab_, -block);
  }

 private:
  Vector3 stretch(const State& state) const {
    return b_ < 0 ? Vector3(state.node_positions.col(a_))
                  : Vector3(state.node_positions.col(a_) - state.node_positions.col(b_));
  }
  int a_, b_;
  double stiffness_;
  BlockSlot aa_, bb_, ab_;
};

// One-sided: 1/2 k min(0, x - offset)^2 along x of one node. Its curvature jumps where it begins to act.
class Wall final : public Energy {
 public:
  Wall(int node, double offset, double stiffness) : node_(node), offset_(offset), stiffness_(stiffness) {}
  std::string_view name() const override { return "wall"; }
  bool has_kinks() const override { return true; }
  void add_pattern(BlockPattern& pattern) const override { pattern.add(node_, node_); }
  void bind(const BlockMatrix& matrix) override { slot_ = matrix.find(node_, node_); }
  double value(const State& state) const override { return 0.5 * stiffness_ * depth(state) * depth(state); }
  double add_gradient(const State& state, VectorX& gradient) const override {
    gradient[3 * node_] += stiffness_ * depth(state);
    return value(state);
  }
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature) const override {
    if (depth(state) == 0) return;
    Matrix3 block = Matrix3::Zero();
    block(0, 0) = stiffness_;
    hessian.add(slot_, block);
  }

 private:
  double depth(const State& state) const { return std::min(0.0, state.node_positions(0, node_) - offset_); }
  int node_;
  double offset_, stiffness_;
  BlockSlot slot_;
};

// A chain of four nodes: 0 is tied to the origin, and walls push nodes 2 and 3.
struct Scene {
  Scene() {
    state.node_positions = state.node_velocities = Eigen::Matrix3Xd::Zero(3, 4);
    for (int n = 0; n < 4; ++n) state.node_positions(0, n) = 0.01 * n - 0.02;
    BlockPattern pattern(4);
    for (Energy* term : all()) term->add_pattern(pattern);
    hessian = BlockMatrix(pattern);
    for (Energy* term : all()) term->bind(hessian);
  }
  std::vector<Energy*> all() { return {&tie, &first, &second, &third, &near, &far}; }
  std::vector<Energy*> walls() { return {&near, &far}; }
  VectorX gradient_at(const State& at) {
    VectorX gradient = VectorX::Zero(12);
    for (Energy* term : all()) term->add_gradient(at, gradient);
    return gradient;
  }
  LocalNewton::Result minimise(VectorX& direction, int most_modes = 0) {
    hessian.set_zero();
    for (Energy* term : {&tie, &first, &second, &third}) term->add_hessian(state, hessian, Curvature::projected);
    hessian.begin_journal();
    for (Energy* term : walls()) term->add_hessian(state, hessian, Curvature::projected);
    factor.analyze(hessian);
    factor.load(hessian);
    EXPECT_TRUE(factor.factorize());
    return solver.minimise(state, walls(), Curvature::projected, gradient_at(state), hessian, most_modes, 1e9, factor,
                           direction);
  }
  bool minimise_condensed(VectorX& direction, int most_blocks = 4) {
    hessian.set_zero();
    for (Energy* term : {&tie, &first, &second, &third}) term->add_hessian(state, hessian, Curvature::projected);
    hessian.begin_journal();
    BorderedSolver smooth(std::make_unique<BlockCholesky<double>>());
    smooth.analyze(hessian);
    smooth.load(hessian);
    EXPECT_TRUE(smooth.factorize());
    Compliance compliance(4, most_blocks);
    return solver.minimise_condensed(state, walls(), Curvature::projected, gradient_at(state), hessian, smooth, {},
                                     compliance, direction) == LocalNewton::Condensed::found;
  }
  Spring tie{0, -1, 100}, first{0, 1, 100}, second{1, 2, 100}, third{2, 3, 100};
  Wall near{2, 0.005, 1e4}, far{3, 0.02, 1e4};
  State state;
  BlockMatrix hessian;
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

// All terms are quadratic except the walls, so the direction leads to the minimum. A node that touches nothing at first
// is not watched on its way: at 0.0071 node 3 enters the wall, and a second direction is needed.
TEST(LocalNewton, CondensedDirectionLeadsToTheMinimum) {
  for (const double far : {0.02, -0.015, 0.0071, -1.0}) {
    Scene scene;
    scene.far = Wall(3, far, 1e4);
    scene.far.bind(scene.hessian);
    VectorX direction(12);
    ASSERT_TRUE(scene.minimise_condensed(direction));
    const BlockMatrix after = scene.hessian;
    EXPECT_TRUE(after.journal().empty());
    EXPECT_GT(direction.head(6).norm(), 0);
    const double before = scene.gradient_at(scene.state).norm();
    EXPECT_GT(before, 1);
    apply_increment(scene.state, direction);
    if (far == 0.0071) {
      EXPECT_GT(scene.gradient_at(scene.state).norm(), 1);
      ASSERT_TRUE(scene.minimise_condensed(direction));
      apply_increment(scene.state, direction);
    }
    EXPECT_LE(scene.gradient_at(scene.state).norm(), 0.01 * before) << "wall at " << far;
  }
}

// Two nodes touch, but there is room for one.
TEST(LocalNewton, RefusesToCondenseMoreThanTheRoom) {
  Scene scene;
  VectorX direction(12);
  EXPECT_FALSE(scene.minimise_condensed(direction, 1));
}

TEST(LocalNewton, CondensesWithoutContact) {
  Scene scene;
  scene.near = Wall(2, -1, 1e4);
  scene.far = Wall(3, -1, 1e4);
  for (Energy* term : scene.walls()) term->bind(scene.hessian);
  VectorX direction(12);
  ASSERT_TRUE(scene.minimise_condensed(direction));
  apply_increment(scene.state, direction);
  EXPECT_LE(scene.gradient_at(scene.state).norm(), 1e-9);
}

}  // namespace
}  // namespace softhand
