// Compliance gives the Schur complement of the blocks that it includes, in any order and for any number of them.
#include "solver/compliance.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "solver/block_cholesky.hpp"
#include "solver/dense_cholesky.hpp"

namespace softhand::compliance_test {
namespace {

BlockMatrix random_matrix(int blocks, std::mt19937& random) {
  BlockPattern pattern(blocks);
  std::vector<std::pair<int, int>> pairs;
  for (int b = 1; b < blocks; ++b) {
    for (const int other : {b - 1, static_cast<int>(random() % static_cast<unsigned>(b))}) {
      pattern.add(b, other);
      pairs.emplace_back(b, other);
    }
  }
  BlockMatrix matrix(pattern);
  std::normal_distribution<double> normal;
  for (int b = 0; b < blocks; ++b) matrix.add(matrix.find(b, b), Matrix3::Identity());
  for (const auto& [row, column] : pairs) {
    Matrix3 a, b;
    for (int i = 0; i < 9; ++i) {
      a(i) = normal(random);
      b(i) = normal(random);
    }
    matrix.add(matrix.find(row, row), a * a.transpose());
    matrix.add(matrix.find(row, column), a * b.transpose());
    matrix.add(matrix.find(column, column), b * b.transpose());
  }
  return matrix;
}

Eigen::MatrixXd stiffness_of(const Compliance& compliance) {
  const auto size = 3 * static_cast<Eigen::Index>(compliance.blocks().size());
  return compliance.stiffness().topLeftCorner(size, size).selfadjointView<Eigen::Lower>();
}

template <typename Scalar>
void check_stiffness(double tolerance) {
  constexpr int kBlocks = 120, kMost = 24;
  std::mt19937 random(3);
  const BlockMatrix matrix = random_matrix(kBlocks, random);
  BlockCholesky<Scalar> factor;
  factor.analyze(matrix);
  factor.load(matrix);
  ASSERT_TRUE(factor.factorize());
  const Eigen::MatrixXd inverse = matrix.dense().inverse();
  Compliance compliance(kBlocks, kMost);
  const std::vector<std::vector<std::int32_t>> additions{{}, {7}, {100, 3, 99}, {0, 119, 50, 51, 52}};
  std::vector<std::int32_t> all;
  for (const auto& added : additions) {
    ASSERT_TRUE(compliance.include(added, factor));
    all.insert(all.end(), added.begin(), added.end());
    ASSERT_EQ(std::vector<std::int32_t>(compliance.blocks().begin(), compliance.blocks().end()), all);
    const auto size = 3 * static_cast<Eigen::Index>(all.size());
    Eigen::MatrixXd g(size, size);
    for (std::size_t i = 0; i < all.size(); ++i) {
      for (std::size_t j = 0; j < all.size(); ++j)
        g.block<3, 3>(3 * static_cast<Eigen::Index>(i), 3 * static_cast<Eigen::Index>(j)) =
            inverse.block<3, 3>(3 * all[i], 3 * all[j]);
    }
    if (size == 0) continue;
    const Eigen::MatrixXd expected = g.inverse();
    EXPECT_LE((stiffness_of(compliance) - expected).norm(), tolerance * expected.norm());
    VectorX product = VectorX::LinSpaced(size, 2, -3);
    const VectorX expected_product = expected * product;
    compliance.multiply_stiffness(product, product);
    EXPECT_LE((product - expected_product).norm(), tolerance * expected_product.norm());
    // Displacements under forces: A^-1 (f + E forces).
    const VectorX forces = VectorX::LinSpaced(size, -1, 2), rhs = VectorX::LinSpaced(3 * kBlocks, 0, 1);
    VectorX half = VectorX::Zero(rhs.size()), x = half, loaded = rhs;
    for (std::size_t i = 0; i < all.size(); ++i)
      loaded.segment<3>(3 * all[i]) += forces.segment<3>(3 * static_cast<Eigen::Index>(i));
    const VectorX moved = inverse * loaded;
    factor.forward(rhs, half);
    compliance.add_forces(forces, half);
    VectorX displacements = VectorX::Zero(size);
    compliance.find_displacements(0, half, displacements);
    for (std::size_t i = 0; i < all.size(); ++i) {
      EXPECT_LE((displacements.segment<3>(3 * static_cast<Eigen::Index>(i)) - moved.segment<3>(3 * all[i])).norm(),
                tolerance * moved.norm());
    }
    factor.backward(half, x);
    EXPECT_LE((x - moved).norm(), tolerance * moved.norm());
  }
  // Too many blocks are refused, and the known ones remain.
  std::vector<std::int32_t> many;
  for (std::int32_t b = 10; b < 10 + kMost; ++b) many.push_back(b);
  EXPECT_FALSE(compliance.include(many, factor));
  EXPECT_EQ(compliance.blocks().size(), all.size());
  // After `clear` all blocks can be included at once. The result does not depend on the history.
  compliance.clear();
  EXPECT_FALSE(compliance.has(7));
  ASSERT_TRUE(compliance.include(many, factor));
  const Eigen::MatrixXd at_once = stiffness_of(compliance);
  compliance.clear();
  for (const std::int32_t block : many) ASSERT_TRUE(compliance.include(std::array{block}, factor));
  EXPECT_LE((stiffness_of(compliance) - at_once).norm(), 1e-12 * at_once.norm());
}

TEST(Compliance, StiffnessIsTheSchurComplementInDouble) { check_stiffness<double>(1e-12); }
TEST(Compliance, StiffnessIsTheSchurComplementInFloat) { check_stiffness<float>(1e-4); }

TEST(Compliance, RefusesAFactorThatIsNotFinite) {
  std::mt19937 random(4);
  BlockMatrix matrix = random_matrix(30, random);
  BlockCholesky<double> factor;
  factor.analyze(matrix);
  factor.load(matrix);
  ASSERT_TRUE(factor.factorize());
  Compliance compliance(30, 10);
  for (double& value : matrix.values()) value = std::nan("");
  factor.factorize();
  EXPECT_FALSE(compliance.include(std::array{5}, factor));
  EXPECT_TRUE(compliance.blocks().empty());
}

TEST(DenseCholesky, SolvesAtEverySize) {
  constexpr int kMost = 20;
  const auto positive = [](Eigen::Index size, std::mt19937& random) {
    std::normal_distribution<double> normal;
    Eigen::MatrixXd a(size, size);
    for (Eigen::Index i = 0; i < a.size(); ++i) a(i) = normal(random);
    DenseCholesky::Dense stored = DenseCholesky::Dense::Constant(3 * kMost, 3 * kMost, std::nan(""));
    stored.topLeftCorner(size, size) = a * a.transpose() + Eigen::MatrixXd::Identity(size, size);
    return stored;
  };
  for (const InstructionSet set : kInstructionSets) {
    if (!is_supported(set)) continue;
    DenseCholesky cholesky(kMost, set);
    for (const auto& [first, second] : {std::pair{0, 1}, {0, 20}, {3, 0}, {1, 1}, {2, 6}, {9, 7}, {0, 19}}) {
      std::mt19937 random(static_cast<unsigned>(first + second));
      const Eigen::Index size = 3 * (first + second), corner = 3 * first, rest = size - corner;
      const DenseCholesky::Dense one = positive(corner, random);
      DenseCholesky::Dense other = positive(rest, random);
      Eigen::MatrixXd matrix = Eigen::MatrixXd::Zero(size, size);
      matrix.topLeftCorner(corner, corner) = one.topLeftCorner(corner, corner);
      matrix.bottomRightCorner(rest, rest) = other.topLeftCorner(rest, rest);
      const Matrix3 part{{0.01, 0.02, 0.03}, {0.04, 0.05, 0.06}, {0.07, 0.08, 0.09}};
      const bool has_pair = first + second > 1;
      if (has_pair) {
        matrix.block<3, 3>(size - 3, 0) += part;
        matrix.block<3, 3>(0, size - 3) += part.transpose();
      }
      cholesky.assign(one, corner, other, rest);
      if (has_pair) cholesky.add(first + second - 1, 0, part);
      ASSERT_TRUE(cholesky.factorize());
      const VectorX rhs = VectorX::LinSpaced(size, 1, 2);
      VectorX x = rhs;
      cholesky.solve(x);
      EXPECT_LE((matrix * x - rhs).norm(), 1e-12 * matrix.norm() * x.norm());
      if (rest == 0) continue;
      other(rest - 1, rest - 1) = -1;
      cholesky.assign(one, corner, other, rest);
      EXPECT_FALSE(cholesky.factorize());
    }
  }
}

}  // namespace
}  // namespace softhand::compliance_test
