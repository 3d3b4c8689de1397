// CondensedNewton moves the blocks that the kinked terms touch. The rest gives way as its Hessian says.
#include "solver/condensed_newton.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "solver/block_cholesky.hpp"
#include "support/pushed_chain.hpp"

namespace softhand::condensed_newton_test {
namespace {

using testing::Spring, testing::Wall;

constexpr double kTolerance = 1e-12;  // N

// One-sided: 1/2 k depth^2 between two blocks, where depth is 0 or grows with x_a and falls with x_b.
class OneSidedSpring : public Energy {
 public:
  OneSidedSpring(int a, int b) : a_(a), b_(b) {}
  std::string_view name() const override { return "one-sided spring"; }
  bool has_kinks() const override { return true; }
  void add_pattern(BlockPattern& pattern) const override {
    pattern.add(a_, a_);
    pattern.add(b_, b_);
    pattern.add(b_, a_);
  }
  void bind(const BlockMatrix& matrix) override {
    aa_ = matrix.find(a_, a_);
    bb_ = matrix.find(b_, b_);
    ba_ = matrix.find(b_, a_);
  }
  double value(const State& state) const override { return 0.5 * kStiffness * depth(state) * depth(state); }
  double add_gradient(const State& state, VectorX& gradient) const override {
    gradient[3 * a_] += kStiffness * depth(state);
    gradient[3 * b_] -= kStiffness * depth(state);
    return value(state);
  }
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature) const override {
    if (depth(state) == 0) return;
    Matrix3 block = Matrix3::Zero();
    block(0, 0) = kStiffness;
    hessian.add(aa_, block);
    hessian.add(bb_, block);
    hessian.add(ba_, -block);
  }

 protected:
  static constexpr double kStiffness = 1e4;
  virtual double depth(const State& state) const = 0;
  int a_, b_;

 private:
  BlockSlot aa_, bb_, ba_;
};

// Node a may be at most 2 mm in front of node b.
class Bumper final : public OneSidedSpring {
 public:
  using OneSidedSpring::OneSidedSpring;

 private:
  double depth(const State& state) const override {
    return std::max(0.0, state.node_positions(0, a_) - state.node_positions(0, b_) - 0.002);
  }
};

struct Scene : testing::PushedChain {
  // `kept`: the factor has this stiffness at node 2 in addition. `is_new`: the solver knows no factor of its own.
  CondensedNewton::Result minimise(VectorX& direction, int most_blocks = 4, double kept = 0, bool is_new = true) {
    if (is_new) solver.forget_factor();
    hessian.set_zero();
    for (Energy* term : {&tie, &first, &second, &third}) term->add_hessian(state, hessian, Curvature::projected);
    hessian.begin_journal();
    const KeptBlock block{hessian.find(2, 2).index, kept * Matrix3::Identity()};
    hessian.add(hessian.find(2, 2), block.value);
    BorderedSolver smooth(std::make_unique<BlockCholesky<double>>());
    smooth.analyze(hessian);
    smooth.load(hessian);
    EXPECT_TRUE(smooth.factorize());
    hessian.take_back();
    Compliance compliance(4, most_blocks);
    return solver.minimise(state, walls(), Curvature::projected, gradient_at(state), kTolerance, hessian, smooth,
                           {&block, 1}, compliance, direction);
  }
  CondensedNewton solver{DofLayout{4, 0}};
};

TEST(CondensedNewton, CountsTouchedBlocksOfTheCore) {
  Scene scene;
  scene.hessian.set_zero();
  scene.hessian.begin_journal();
  EXPECT_EQ(scene.solver.touched_blocks(scene.hessian), 0);
  for (Energy* term : scene.walls()) term->add_hessian(scene.state, scene.hessian, Curvature::projected);
  EXPECT_EQ(scene.solver.touched_blocks(scene.hessian), 2);
}

// All terms are quadratic except the walls, so the direction leads to the minimum. A node that touches nothing at first
// is not watched on its way: at 0.0071 node 3 enters the wall, and a second direction is needed.
TEST(CondensedNewton, DirectionLeadsToTheMinimum) {
  for (const double far : {0.02, -0.015, 0.0071, -1.0}) {
    Scene scene;
    scene.far = Wall(3, far, 1e4);
    scene.far.bind(scene.hessian);
    VectorX direction(12);
    ASSERT_EQ(scene.minimise(direction), CondensedNewton::Result::found);
    const BlockMatrix after = scene.hessian;
    EXPECT_TRUE(after.journal().empty());
    EXPECT_GT(direction.head(6).norm(), 0);
    const double before = scene.gradient_at(scene.state).norm();
    EXPECT_GT(before, 1);
    apply_increment(scene.state, direction);
    if (far == 0.0071) {
      EXPECT_GT(scene.gradient_at(scene.state).norm(), 1);
      ASSERT_EQ(scene.minimise(direction), CondensedNewton::Result::found);
      apply_increment(scene.state, direction);
    }
    EXPECT_LE(scene.gradient_at(scene.state).norm(), 0.01 * before) << "wall at " << far;
  }
}

// What the factor keeps of the contact is subtracted from the model, so it changes only rounding.
TEST(CondensedNewton, KeptContactDoesNotChangeTheDirection) {
  Scene scene;
  VectorX direction(12), with_kept(12);
  ASSERT_EQ(scene.minimise(direction), CondensedNewton::Result::found);
  ASSERT_EQ(scene.minimise(with_kept, 4, 300), CondensedNewton::Result::found);
  EXPECT_LE((with_kept - direction).norm(), 1e-10 * direction.norm());
}

// A node may not be behind a body of the border.
class Pad final : public OneSidedSpring {
 public:
  Pad(DofLayout layout, int node) : OneSidedSpring(node, layout.body_translation_block(0)) {}

 private:
  double depth(const State& state) const override {
    return std::min(0.0, state.node_positions(0, a_) - state.body_poses[0].position.x());
  }
};

// Two nodes push a body of the border, which is held by springs.
TEST(CondensedNewton, DirectionMovesTheTouchedBody) {
  const DofLayout layout{3, 1, 1};
  Spring tie(0, -1, 100), first(0, 1, 100), second(1, 2, 100);
  const Vector3 rest(0.01, 0, 0);  // of the body
  Pad near(layout, 1), far(layout, 2);
  State state = empty_state(layout);
  state.node_positions << 0.0, -0.02, -0.01, 0, 0, 0, 0, 0, 0;
  BlockPattern pattern(layout.block_count(), layout.border_count());
  for (Energy* term : std::initializer_list<Energy*>{&tie, &first, &second, &near, &far}) term->add_pattern(pattern);
  BlockMatrix hessian(pattern);
  for (Energy* term : std::initializer_list<Energy*>{&tie, &first, &second, &near, &far}) term->bind(hessian);
  const auto add_smooth = [&] {
    for (const Spring* spring : {&tie, &first, &second}) spring->add_hessian(state, hessian, Curvature::projected);
    for (int block = 3; block < 5; ++block) hessian.add(hessian.find(block, block), 50 * Matrix3::Identity());
  };
  const auto gradient_at = [&](const State& at) {
    VectorX gradient = VectorX::Zero(layout.dof_count());
    for (const Spring* spring : {&tie, &first, &second}) spring->add_gradient(at, gradient);
    gradient.segment<3>(3 * layout.body_translation_block(0)) += 50 * (at.body_poses[0].position - rest);
    near.add_gradient(at, gradient);
    far.add_gradient(at, gradient);
    return gradient;
  };
  hessian.set_zero();
  add_smooth();
  hessian.begin_journal();
  BorderedSolver factor(std::make_unique<BlockCholesky<double>>());
  factor.analyze(hessian);
  factor.load(hessian);
  ASSERT_TRUE(factor.factorize());
  Compliance compliance(3, 3);
  CondensedNewton solver(layout);
  VectorX direction(layout.dof_count());
  const std::vector<Energy*> pads{&near, &far};
  ASSERT_EQ(solver.minimise(state, pads, Curvature::projected, gradient_at(state), kTolerance, hessian, factor, {},
                            compliance, direction),
            CondensedNewton::Result::found);
  const double moved = direction[3 * layout.body_translation_block(0)];
  EXPECT_GT(moved, 1e-3);
  EXPECT_LT(moved, 0.9 * rest.x()) << "the nodes hold the body back";
  EXPECT_GT(gradient_at(state).norm(), 100);
  apply_increment(state, direction);
  EXPECT_LE(gradient_at(state).norm(), 1e-9);
}

// The factor of the dense matrix serves again if the stiffness of contact has hardly changed.
TEST(CondensedNewton, FactorServesUntilContactChanges) {
  Scene scene;
  scene.far = Wall(3, -1, 1e4);  // touches nothing
  scene.far.bind(scene.hessian);
  VectorX direction(12);
  ASSERT_EQ(scene.minimise(direction), CondensedNewton::Result::found);
  apply_increment(scene.state, direction);
  const auto set_wall = [&](double offset, double stiffness) {
    scene.near = Wall(2, offset, stiffness);
    scene.near.bind(scene.hessian);
  };
  const auto operations = [&](bool is_new) {
    EXPECT_EQ(scene.minimise(direction, 4, 0, is_new), CondensedNewton::Result::found);
    State moved = scene.state;
    apply_increment(moved, direction);
    EXPECT_LE(scene.gradient_at(moved).norm(), 0.01 * scene.gradient_at(scene.state).norm());
    return scene.solver.take_operations();
  };
  set_wall(0.00505, 1e4);  // 0.05 mm further
  const double with_factor = operations(true), again = operations(false);
  EXPECT_LT(again, with_factor);
  set_wall(0.00505, 1.0005e4);
  EXPECT_EQ(operations(false), again);
  set_wall(0.00505, 2e4);
  const double changed = operations(false);
  EXPECT_EQ(changed, operations(true));
}

// A relaxed chain of four nodes. A wall pushes node 1. Where the others have not followed yet, a bumper pushes them.
struct Train {
  explicit Train(Vector3 second_and_third = Vector3::Zero()) {
    state.node_positions = state.node_velocities = Eigen::Matrix3Xd::Zero(3, 4);
    for (int n = 2; n < 4; ++n) state.node_positions.col(n) = second_and_third;
    BlockPattern pattern(4);
    for (Energy* term : all()) term->add_pattern(pattern);
    hessian = BlockMatrix(pattern);
    for (Energy* term : all()) term->bind(hessian);
  }
  std::vector<Energy*> smooth() { return {&tie, &first, &second, &third}; }
  std::vector<Energy*> kinked() { return {&wall, &front, &back}; }
  std::vector<Energy*> all() { return {&tie, &first, &second, &third, &wall, &front, &back}; }
  VectorX direction(CondensedNewton& solver) {
    VectorX gradient = VectorX::Zero(12), direction(12);
    for (Energy* term : all()) term->add_gradient(state, gradient);
    hessian.set_zero();
    for (Energy* term : smooth()) term->add_hessian(state, hessian, Curvature::projected);
    BorderedSolver factor(std::make_unique<BlockCholesky<double>>());
    factor.analyze(hessian);
    factor.load(hessian);
    EXPECT_TRUE(factor.factorize());
    hessian.begin_journal();
    Compliance compliance(4, 4);
    EXPECT_EQ(solver.minimise(state, kinked(), Curvature::projected, gradient, kTolerance, hessian, factor, {},
                              compliance, direction),
              CondensedNewton::Result::found);
    return direction;
  }
  Spring tie{0, -1, 100}, first{0, 1, 100}, second{1, 2, 100}, third{2, 3, 100};
  Wall wall{1, 0.01, 1e4};
  Bumper front{1, 2}, back{2, 3};
  State state;
  BlockMatrix hessian;
};

// Node 1 moves and touches node 2. Node 2 then moves as the forces so far move it, and touches node 3 in the same
// iteration. The forces at that moment were those of an earlier solve, so a loaded state did not repeat a run.
TEST(CondensedNewton, ASolveDependsOnNoEarlierOne) {
  CondensedNewton fresh(DofLayout{4, 0}), used(DofLayout{4, 0});
  EXPECT_GT(Train(Vector3(-0.02, 0.01, 0)).direction(used).norm(), 0.01);
  const VectorX expected = Train().direction(fresh), found = Train().direction(used);
  EXPECT_EQ(found, expected);
  // The wall pushes against the two springs behind node 1, and the nodes in front of it follow.
  const double pushed = 0.01 * 1e4 / (1e4 + 50);
  for (int n = 1; n < 4; ++n) EXPECT_NEAR(found[3 * n], pushed, 1e-6) << n;
}

// Two nodes touch, but there is room for one.
TEST(CondensedNewton, RefusesMoreThanTheRoom) {
  Scene scene;
  VectorX direction(12);
  EXPECT_EQ(scene.minimise(direction, 1), CondensedNewton::Result::no_room);
}

TEST(CondensedNewton, WorksWithoutContact) {
  Scene scene;
  scene.near = Wall(2, -1, 1e4);
  scene.far = Wall(3, -1, 1e4);
  for (Energy* term : scene.walls()) term->bind(scene.hessian);
  VectorX direction(12);
  ASSERT_EQ(scene.minimise(direction), CondensedNewton::Result::found);
  apply_increment(scene.state, direction);
  EXPECT_LE(scene.gradient_at(scene.state).norm(), 1e-9);
}

}  // namespace
}  // namespace softhand::condensed_newton_test
