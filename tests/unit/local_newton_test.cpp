// LocalNewton moves only the blocks that the kinked terms touch, to the minimum over these blocks.
#include "solver/local_newton.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "solver/block_cholesky.hpp"

namespace softhand::local_newton_test {
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
  // `kept`: the factor has this stiffness at node 2 in addition. `is_new`: the solver knows no factor of its own.
  LocalNewton::Condensed minimise_condensed(VectorX& direction, int most_blocks = 4, double kept = 0,
                                            bool is_new = true) {
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
    return solver.minimise_condensed(state, walls(), Curvature::projected, gradient_at(state), kTolerance, hessian,
                                     smooth, {&block, 1}, compliance, direction);
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

// Nodes in a row, each tied to the origin and pushed by a wall. Springs connect each node with the next `reach` nodes.
LocalNewton::Result push_row(int count, int reach, double most_operations, VectorX& direction) {
  std::vector<std::unique_ptr<Energy>> springs, walls;
  for (int n = 0; n < count; ++n) {
    springs.push_back(std::make_unique<Spring>(n, -1, 100));
    for (int other = n + 1; other < std::min(count, n + reach + 1); ++other)
      springs.push_back(std::make_unique<Spring>(n, other, 1));
    walls.push_back(std::make_unique<Wall>(n, 0.01, 1e4));
  }
  State state;
  state.node_positions = state.node_velocities = Eigen::Matrix3Xd::Zero(3, count);
  BlockPattern pattern(count);
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
  EXPECT_EQ(solver.touched_blocks(hessian), count);
  BlockCholesky<double> factor;
  direction = VectorX::Zero(3 * count);
  return solver.minimise(state, kinked, Curvature::projected, gradient, hessian, 0, most_operations, factor, direction);
}

// A step of a power grasp that was cut off touches with 200 nodes. Before, more than 128 were refused.
TEST(LocalNewton, MovesAllTouchedNodesOfAPowerGrasp) {
  VectorX direction;
  ASSERT_TRUE(push_row(200, 1, 1e6, direction).found);
  for (int n = 0; n < 200; ++n) EXPECT_NEAR(direction[3 * n], 1e4 * 0.01 / (1e4 + 100), 1e-9);
  EXPECT_FALSE(push_row(LocalNewton::kMaxBlocks + 1, 1, 1e6, direction).found);
}

// The factor of nodes that are all coupled with each other costs more than the tissue.
TEST(LocalNewton, RefusesAFactorThatCostsTooMuch) {
  VectorX direction;
  EXPECT_FALSE(push_row(100, 100, 1e6, direction).found);
  EXPECT_TRUE(push_row(100, 100, 1e7, direction).found);
}

// All terms are quadratic except the walls, so the direction leads to the minimum. A node that touches nothing at first
// is not watched on its way: at 0.0071 node 3 enters the wall, and a second direction is needed.
TEST(LocalNewton, CondensedDirectionLeadsToTheMinimum) {
  for (const double far : {0.02, -0.015, 0.0071, -1.0}) {
    Scene scene;
    scene.far = Wall(3, far, 1e4);
    scene.far.bind(scene.hessian);
    VectorX direction(12);
    ASSERT_EQ(scene.minimise_condensed(direction), LocalNewton::Condensed::found);
    const BlockMatrix after = scene.hessian;
    EXPECT_TRUE(after.journal().empty());
    EXPECT_GT(direction.head(6).norm(), 0);
    const double before = scene.gradient_at(scene.state).norm();
    EXPECT_GT(before, 1);
    apply_increment(scene.state, direction);
    if (far == 0.0071) {
      EXPECT_GT(scene.gradient_at(scene.state).norm(), 1);
      ASSERT_EQ(scene.minimise_condensed(direction), LocalNewton::Condensed::found);
      apply_increment(scene.state, direction);
    }
    EXPECT_LE(scene.gradient_at(scene.state).norm(), 0.01 * before) << "wall at " << far;
  }
}

// What the factor keeps of the contact is subtracted from the model, so it changes only rounding.
TEST(LocalNewton, KeptContactDoesNotChangeTheCondensedDirection) {
  Scene scene;
  VectorX direction(12), with_kept(12);
  ASSERT_EQ(scene.minimise_condensed(direction), LocalNewton::Condensed::found);
  ASSERT_EQ(scene.minimise_condensed(with_kept, 4, 300), LocalNewton::Condensed::found);
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
TEST(LocalNewton, CondensedDirectionMovesTheTouchedBody) {
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
  LocalNewton solver(layout);
  VectorX direction(layout.dof_count());
  const std::vector<Energy*> pads{&near, &far};
  ASSERT_EQ(solver.minimise_condensed(state, pads, Curvature::projected, gradient_at(state), kTolerance, hessian,
                                      factor, {}, compliance, direction),
            LocalNewton::Condensed::found);
  const double moved = direction[3 * layout.body_translation_block(0)];
  EXPECT_GT(moved, 1e-3);
  EXPECT_LT(moved, 0.9 * rest.x()) << "the nodes hold the body back";
  EXPECT_GT(gradient_at(state).norm(), 100);
  apply_increment(state, direction);
  EXPECT_LE(gradient_at(state).norm(), 1e-9);
}

// The factor of the dense matrix serves again if the stiffness of contact has hardly changed.
TEST(LocalNewton, CondensedFactorServesUntilContactChanges) {
  Scene scene;
  scene.far = Wall(3, -1, 1e4);  // touches nothing
  scene.far.bind(scene.hessian);
  VectorX direction(12);
  ASSERT_EQ(scene.minimise_condensed(direction), LocalNewton::Condensed::found);
  apply_increment(scene.state, direction);
  const auto set_wall = [&](double offset, double stiffness) {
    scene.near = Wall(2, offset, stiffness);
    scene.near.bind(scene.hessian);
  };
  const auto operations = [&](bool is_new) {
    EXPECT_EQ(scene.minimise_condensed(direction, 4, 0, is_new), LocalNewton::Condensed::found);
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

// Two nodes touch, but there is room for one.
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
  VectorX direction(LocalNewton& solver) {
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
    EXPECT_EQ(solver.minimise_condensed(state, kinked(), Curvature::projected, gradient, kTolerance, hessian, factor,
                                        {}, compliance, direction),
              LocalNewton::Condensed::found);
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
TEST(LocalNewton, ASolveDependsOnNoEarlierOne) {
  LocalNewton fresh(DofLayout{4, 0}), used(DofLayout{4, 0});
  EXPECT_GT(Train(Vector3(-0.02, 0.01, 0)).direction(used).norm(), 0.01);
  const VectorX expected = Train().direction(fresh), found = Train().direction(used);
  EXPECT_EQ(found, expected);
  // The wall pushes against the two springs behind node 1, and the nodes in front of it follow.
  const double pushed = 0.01 * 1e4 / (1e4 + 50);
  for (int n = 1; n < 4; ++n) EXPECT_NEAR(found[3 * n], pushed, 1e-6) << n;
}

TEST(LocalNewton, RefusesToCondenseMoreThanTheRoom) {
  Scene scene;
  VectorX direction(12);
  EXPECT_EQ(scene.minimise_condensed(direction, 1), LocalNewton::Condensed::no_room);
}

TEST(LocalNewton, CondensesWithoutContact) {
  Scene scene;
  scene.near = Wall(2, -1, 1e4);
  scene.far = Wall(3, -1, 1e4);
  for (Energy* term : scene.walls()) term->bind(scene.hessian);
  VectorX direction(12);
  ASSERT_EQ(scene.minimise_condensed(direction), LocalNewton::Condensed::found);
  apply_increment(scene.state, direction);
  EXPECT_LE(scene.gradient_at(scene.state).norm(), 1e-9);
}

}  // namespace
}  // namespace softhand::local_newton_test
