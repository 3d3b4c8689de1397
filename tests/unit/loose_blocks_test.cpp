// Loose blocks: blocks of the Hessian outside the pattern of its factor, and solves with them.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <limits>

#include "solver/loose_solve.hpp"
#include "support/box_mesh.hpp"

namespace softhand::loose_blocks_test {
namespace {

BlockPattern chain(int blocks, int loose, int border = 0) {
  BlockPattern pattern(blocks, border);
  for (int b = 1; b < blocks - border; ++b) pattern.add(b, b - 1);
  pattern.add_loose(loose);
  return pattern;
}

TEST(LooseBlocks, AreAddedAnywhereAndEndWithTheJournal) {
  BlockMatrix matrix(chain(8, 3, 2));
  const Matrix3 block = (Matrix3() << 1, 2, 3, 4, 5, 6, 7, 8, 9).finished();
  EXPECT_TRUE(matrix.is_core(matrix.pair(3, 2).index)) << "a block of the pattern is not loose";
  EXPECT_TRUE(matrix.loose_in_use().empty());
  matrix.begin_journal();
  matrix.add(matrix.pair(5, 1), block);
  matrix.add(matrix.pair(1, 5), block);
  matrix.add(matrix.pair(4, 0), block);
  matrix.add(matrix.find(7, 2), block);  // a block of the border between two loose ones
  EXPECT_EQ(matrix.loose_in_use().size(), 2u);
  Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(24, 24);
  expected.block<3, 3>(15, 3) = block + block.transpose();
  expected.block<3, 3>(12, 0) = block;
  expected.block<3, 3>(21, 6) = block;
  expected += expected.transpose().eval();
  EXPECT_EQ(matrix.dense(), expected);
  VectorX x = VectorX::LinSpaced(24, -1, 2), y;
  matrix.multiply(x, y);
  EXPECT_LE((y - expected * x).norm(), 1e-12);
  EXPECT_EQ(matrix.position(matrix.pair(0, 4).index), (std::pair<std::int32_t, std::int32_t>(4, 0)));
  EXPECT_GE(matrix.pair(5, 2).index, 0);
  EXPECT_EQ(matrix.pair(5, 3).index, -1) << "there is no room for a fourth one";
  matrix.take_back();
  EXPECT_TRUE(matrix.loose_in_use().empty());
  EXPECT_TRUE(matrix.dense().isZero(0));
  matrix.add(matrix.pair(5, 3), block);
  matrix.set_zero();
  EXPECT_TRUE(matrix.dense().isZero(0));
  EXPECT_TRUE(matrix.loose_in_use().empty());
}

// A term that couples distant nodes of a chain of springs.
class FarSprings final : public Energy {
 public:
  explicit FarSprings(int nodes) : nodes_(nodes) {}
  std::string_view name() const override { return "far"; }
  void add_pattern(BlockPattern& pattern) const override {
    for (int n = 1; n < nodes_; ++n) pattern.add(n, n - 1);
    pattern.add_loose(nodes_);
  }
  void bind(const BlockMatrix&) override {}
  double value(const State&) const override { return 0; }
  double add_gradient(const State&, VectorX&) const override { return 0; }
  void add_hessian(const State&, BlockMatrix& hessian, Curvature) const override {
    testing::Random random(3);
    for (int n = 0; n < nodes_; ++n) hessian.add(hessian.find(n, n), 10 * Matrix3::Identity());
    const auto couple = [&](int a, int b, double stiffness) {
      const Vector3 along = random.vector().normalized();
      const Matrix3 block = stiffness * along * along.transpose();
      hessian.add(hessian.find(a, a), block);
      hessian.add(hessian.find(b, b), block);
      hessian.add(hessian.pair(a, b), -block);
    };
    for (int n = 1; n < nodes_; ++n) couple(n, n - 1, 100);
    for (int n = 0; n < nodes_ / 4; ++n) couple(n, nodes_ - 1 - n, 1000);
  }

 private:
  int nodes_;
};

TEST(LooseBlocks, SolveTakesThemIntoAccount) {
  constexpr int kNodes = 40;
  FarSprings springs(kNodes);
  SolverOptions options;
  DofLayout layout;
  layout.node_count = kNodes;
  IncrementalPotential potential({&springs}, layout, options);
  HessianFactor factor(options, potential.hessian());
  const StepWork prices{.solve = 1};
  const std::function<double()> clock = [] { return 0.0; };
  StepMeter meter(prices, clock);
  const State state = empty_state(layout);
  potential.evaluate(state, meter, {.hessian = true});
  ASSERT_EQ(potential.hessian().loose_in_use().size(), 10u);
  ASSERT_TRUE(factor.renew(potential, state, false, false, meter));
  VectorX rhs(3 * kNodes), x(3 * kNodes), plain(3 * kNodes);
  testing::Random random(8);
  for (Eigen::Index i = 0; i < rhs.size(); ++i) rhs[i] = random();
  factor.solve(rhs, plain, meter);
  LooseSolve loose(3 * kNodes);
  const double before = meter.report.work;
  loose.solve(factor, potential.hessian(), rhs, x, std::numeric_limits<double>::infinity(), meter);
  EXPECT_LE(meter.report.work - before, 13.0) << "solves";
  EXPECT_GT(meter.report.work - before, 3.0) << "solves";
  const Eigen::MatrixXd matrix = potential.hessian().dense();
  const VectorX exact = matrix.ldlt().solve(rhs);
  const auto error = [&](const VectorX& y) { return std::sqrt((y - exact).dot(matrix * (y - exact))); };
  EXPECT_LE(error(x), 0.3 * error(plain));
  EXPECT_LE(error(x), 0.15 * std::sqrt(exact.dot(matrix * exact)));

  const double cut_off = meter.report.work;
  loose.solve(factor, potential.hessian(), rhs, x, 3, meter);
  EXPECT_EQ(meter.report.work - cut_off, 3.0) << "solves";
  EXPECT_LE(error(x), error(plain));
}

}  // namespace
}  // namespace softhand::loose_blocks_test
