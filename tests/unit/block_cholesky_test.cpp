// Compares the multifrontal factorisation with CHOLMOD and dense Eigen, for each instruction set of this processor and
// both scalars.
#include "solver/block_cholesky.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <type_traits>
#include <utility>

#include "solver/cholmod_solver.hpp"
#include "support/cores.hpp"
#include "support/count_allocations.hpp"
#include "support/hand_matrix.hpp"

namespace softhand::block_cholesky_test {
namespace {

using testing::Random;

template <typename Scalar>
double tolerance() {
  return std::is_same_v<Scalar, double> ? 1e-11 : 2e-4;
}

std::string hand_path(const char* size) {
  return std::string(SOFTHAND_SOURCE_DIR "/config/hands/right_") + size + ".hand.json";
}

VectorX random_vector(Eigen::Index size, std::uint64_t seed) {
  Random random(seed);
  VectorX x(size);
  for (Eigen::Index i = 0; i < size; ++i) x[i] = random();
  return x;
}

// Each pair of blocks exists with the probability `density`. The matrix is diagonally dominant. Its rows and columns
// are scaled, each entry by up to `spread` in all.
BlockMatrix random_matrix(int blocks, double density, double spread, std::uint64_t seed) {
  Random random(seed);
  BlockPattern pattern(blocks);
  for (int a = 0; a < blocks; ++a) {
    for (int b = 0; b < a; ++b) {
      if (0.5 * (random() + 1) < density) pattern.add(a, b);
    }
  }
  BlockMatrix matrix(pattern);
  std::vector<double> sum(static_cast<std::size_t>(3 * blocks), 0.0);
  const auto at = [](int i) { return static_cast<std::size_t>(i); };
  for (const auto& [column, row] : pattern.lower_triangle()) {
    if (row == column) continue;
    const Matrix3 block = (Matrix3() << random.vector(), random.vector(), random.vector()).finished();
    matrix.add(matrix.find(row, column), block);
    for (int k = 0; k < 3; ++k) {
      sum[at(3 * row + k)] += block.row(k).cwiseAbs().sum();
      sum[at(3 * column + k)] += block.col(k).cwiseAbs().sum();
    }
  }
  for (int b = 0; b < blocks; ++b) {
    Matrix3 diagonal = 0.1 * Matrix3::Identity();
    for (int k = 0; k < 3; ++k) diagonal(k, k) += sum[at(3 * b + k)];
    matrix.add(matrix.find(b, b), diagonal);
  }
  std::vector<double> scale;
  for (int b = 0; b < blocks; ++b) scale.push_back(std::pow(spread, 0.25 * (random() + 1)));
  for (const auto& [column, row] : pattern.lower_triangle()) {
    const auto values = matrix.values().subspan(9 * static_cast<std::size_t>(matrix.find(row, column).index), 9);
    for (double& value : values) value *= scale[at(row)] * scale[at(column)];
  }
  return matrix;
}

// The residual over |A| |x|. A backward stable solver keeps it at rounding, however bad the condition.
double backward_error(const BlockMatrix& matrix, const VectorX& x, const VectorX& rhs) {
  VectorX product(rhs.size());
  matrix.multiply(x, product);
  BlockMatrix magnitude = matrix;
  for (double& value : magnitude.values()) value = std::abs(value);
  VectorX bound(rhs.size());
  magnitude.multiply(x.cwiseAbs(), bound);
  return ((product - rhs).array().abs() / (bound + rhs.cwiseAbs()).array().max(1e-300)).maxCoeff();
}

template <typename Scalar>
class BlockCholeskyTest : public ::testing::Test {
 protected:
  static std::vector<InstructionSet> sets() {
    std::vector<InstructionSet> supported;
    for (const InstructionSet set : kInstructionSets) {
      if (is_supported(set)) supported.push_back(set);
    }
    return supported;
  }
};
using Scalars = ::testing::Types<double, float>;
TYPED_TEST_SUITE(BlockCholeskyTest, Scalars, );

TYPED_TEST(BlockCholeskyTest, AgreesWithDenseOnRandomPatterns) {
  for (const InstructionSet set : this->sets()) {
    BlockCholesky<TypeParam> solver(set);
    for (const int blocks : {1, 2, 3, 5, 8, 17, 40, 90}) {
      for (const double density : {0.0, 0.05, 0.3, 1.0}) {
        for (const double spread : {1.0, 1e8}) {
          const BlockMatrix matrix = random_matrix(blocks, density, spread, static_cast<std::uint64_t>(blocks));
          const VectorX rhs = random_vector(3 * blocks, 7);
          const VectorX expected = matrix.dense().llt().solve(rhs);
          VectorX x(rhs.size());
          solver.analyze(matrix);
          solver.load(matrix);
          ASSERT_TRUE(solver.factorize()) << blocks << ' ' << density;
          solver.solve(rhs, x);
          EXPECT_LE((x - expected).norm(), tolerance<TypeParam>() * expected.norm())
              << to_string(set) << ' ' << blocks << ' ' << density << ' ' << spread;
          EXPECT_LE(backward_error(matrix, x, rhs),
                    200 * static_cast<double>(std::numeric_limits<TypeParam>::epsilon()));
        }
      }
    }
  }
}

TYPED_TEST(BlockCholeskyTest, AgreesWithCholmodOnTheHands) {
  for (const char* size : {"400", "750", "1450", "3000"}) {
    for (const double contact : {12000.0, 1e8}) {
      const BlockMatrix matrix = testing::hand_matrix(hand_path(size), contact);
      const VectorX rhs = random_vector(3 * matrix.block_count(), 3);
      VectorX x(rhs.size()), expected(rhs.size());
      CholmodSolver reference;
      reference.analyze(matrix);
      reference.load(matrix);
      ASSERT_TRUE(reference.factorize());
      reference.solve(rhs, expected);
      for (const InstructionSet set : this->sets()) {
        BlockCholesky<TypeParam> solver(set);
        solver.analyze(matrix);
        solver.load(matrix);
        ASSERT_TRUE(solver.factorize()) << size << ' ' << contact;
        solver.solve(rhs, x);
        EXPECT_LE(backward_error(matrix, x, rhs), 200 * static_cast<double>(std::numeric_limits<TypeParam>::epsilon()))
            << to_string(set) << ' ' << size << ' ' << contact;
        // The condition number limits the number of correct digits of the solution.
        if constexpr (std::is_same_v<TypeParam, double>) {
          EXPECT_LE((x - expected).norm(), 1e-7 * expected.norm());
        }
      }
    }
  }
}

TYPED_TEST(BlockCholeskyTest, TwoThreadsGiveTheBitsOfOne) {
  if (testing::allowed_cores() < 2) GTEST_SKIP() << "one core";
  HelperThread helper;
  ASSERT_TRUE(helper.present());
  for (const char* size : {"400", "1450"}) {
    const BlockMatrix good = testing::hand_matrix(hand_path(size));
    BlockMatrix bad = good;
    const VectorX rhs = random_vector(3 * good.block_count(), 3);
    VectorX x(rhs.size()), expected(rhs.size());
    BlockCholesky<TypeParam> alone, shared(widest_instruction_set(), &helper);
    alone.analyze(good);
    shared.analyze(good);
    alone.load(good);
    ASSERT_TRUE(alone.factorize());
    alone.solve(rhs, expected);
    for (int run = 0; run < 100; ++run) {
      shared.load(good);
      ASSERT_TRUE(shared.factorize());
      shared.solve(rhs, x);
      ASSERT_EQ(x, expected) << size << ' ' << run;
      // Either of the two threads may meet the bad pivot.
      const int block = run * (good.block_count() - 1) / 99;
      double& pivot = bad.values()[9 * static_cast<std::size_t>(bad.find(block, block).index)];
      const double was = std::exchange(pivot, -1.0);
      shared.load(bad);
      EXPECT_FALSE(shared.factorize());
      pivot = was;
    }
  }
}

TYPED_TEST(BlockCholeskyTest, PartialRefactorisationGivesTheBitsOfANewFactorWithLessWork) {
  HelperThread helper;
  for (const char* size : {"400", "1450"}) {
    BlockMatrix matrix = testing::hand_matrix(hand_path(size));
    const VectorX rhs = random_vector(3 * matrix.block_count(), 3);
    VectorX x(rhs.size()), expected(rhs.size());
    BlockCholesky<TypeParam> fresh, reused(widest_instruction_set(), &helper), copied;
    for (BlockCholesky<TypeParam>* solver : {&fresh, &reused, &copied}) solver->analyze(matrix);
    reused.load(matrix);
    ASSERT_TRUE(reused.refactorize({})) << "there is no factor yet: everything is factorised";
    EXPECT_EQ(reused.factorised_fronts(), reused.front_count());
    std::size_t fronts = 0;
    for (int run = 0; run < 40; ++run) {
      // The blocks of two neighbouring nodes, as when a finger touches. Only one of the two really changes.
      std::vector<std::int32_t> changed;
      for (const int node : {37 * run % (matrix.block_count() - 60), 37 * run % (matrix.block_count() - 60) + 1}) {
        const std::int32_t block = matrix.find(node, node).index;
        matrix.values()[9 * static_cast<std::size_t>(block)] *= node % 2 == 0 ? 1.0 : 1.5;
        changed.push_back(block);
      }
      if (run == 20) {
        ASSERT_TRUE(copied.take_factor(reused));
      }
      BlockCholesky<TypeParam>& solver = run < 20 ? reused : copied;
      solver.load(matrix);
      ASSERT_TRUE(solver.refactorize(changed));
      fronts += solver.factorised_fronts();
      solver.solve(rhs, x);
      fresh.load(matrix);
      ASSERT_TRUE(fresh.factorize());
      fresh.solve(rhs, expected);
      ASSERT_EQ(x, expected) << size << ' ' << run;
    }
    EXPECT_LE(fronts, 40 * fresh.front_count() / 2) << size;
    // After a failure there is no factor to start from.
    double& pivot = matrix.values()[9 * static_cast<std::size_t>(matrix.find(5, 5).index)];
    const double was = std::exchange(pivot, -1.0);
    const std::int32_t changed[1] = {matrix.find(5, 5).index};
    EXPECT_FALSE(copied.refactorize(changed));
    pivot = was;
    ASSERT_TRUE(copied.refactorize({}));
    copied.solve(rhs, x);
    EXPECT_EQ(x, expected);
  }
}

TYPED_TEST(BlockCholeskyTest, RefusesMatricesThatAreNotPositiveDefiniteAndRecovers) {
  const BlockMatrix good = testing::hand_matrix(hand_path("400"));
  for (const InstructionSet set : this->sets()) {
    BlockCholesky<TypeParam> solver(set);
    solver.analyze(good);
    for (const int block : {0, 57, good.block_count() - 1}) {
      for (const double bad : {-1.0, 0.0, -1e9, std::nan(""), double(INFINITY)}) {
        BlockMatrix matrix = good;
        matrix.values()[9 * static_cast<std::size_t>(matrix.find(block, block).index) + 4] = bad;
        solver.load(matrix);
        EXPECT_FALSE(solver.factorize()) << block << ' ' << bad;
        solver.load(good);
        EXPECT_TRUE(solver.factorize());
      }
    }
    BlockMatrix matrix = good;
    for (double& value : matrix.values().subspan(9 * static_cast<std::size_t>(matrix.stored_blocks() / 2), 9))
      value = std::nan("");
    solver.load(matrix);
    EXPECT_FALSE(solver.factorize());
  }
}

TYPED_TEST(BlockCholeskyTest, EmptyColumnIsNotPositiveDefinite) {
  BlockMatrix matrix = random_matrix(6, 0.0, 1.0, 1);
  BlockCholesky<TypeParam> solver;
  solver.analyze(matrix);
  solver.load(matrix);
  EXPECT_TRUE(solver.factorize());
  for (double& value : matrix.values().subspan(9 * 3, 9)) value = 0;
  solver.load(matrix);
  EXPECT_FALSE(solver.factorize());
}

TYPED_TEST(BlockCholeskyTest, AcceptsAnEmptyMatrix) {
  const BlockMatrix matrix{BlockPattern(0)};
  BlockCholesky<TypeParam> solver;
  solver.analyze(matrix);
  solver.load(matrix);
  EXPECT_TRUE(solver.factorize());
  VectorX x(0);
  solver.solve(x, x);
}

TYPED_TEST(BlockCholeskyTest, RepeatsTheSameBitsWithoutAllocationAfterAnalysis) {
  const BlockMatrix matrix = testing::hand_matrix(hand_path("400"));
  const BlockMatrix other = testing::hand_matrix(hand_path("400"), 1e6);
  const VectorX rhs = random_vector(3 * matrix.block_count(), 5);
  BlockCholesky<TypeParam> solver;
  solver.analyze(matrix);
  VectorX first(rhs.size()), x(rhs.size());
  solver.load(matrix);
  ASSERT_TRUE(solver.factorize());
  solver.solve(rhs, first);
  allocations = 0;
  counting = true;
  bool positive = true;
  for (int run = 0; run < 3; ++run) {
    solver.load(other);
    positive = solver.factorize() && positive;
    solver.load(matrix);
    positive = solver.factorize() && positive;
    solver.solve(rhs, x);
  }
  counting = false;
  EXPECT_TRUE(positive);
  EXPECT_EQ(allocations, 0);
  EXPECT_TRUE((x.array() == first.array()).all());
#ifdef SOFTHAND_COUNT_MALLOC
  counting = true;
  solver.analyze(matrix);
  counting = false;
  EXPECT_GT(allocations, 0) << "the counter does not count";
#endif
}

}  // namespace
}  // namespace softhand::block_cholesky_test
