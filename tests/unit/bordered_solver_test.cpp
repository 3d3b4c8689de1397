// Systems with a border: solutions, independent blocks, partial factorisation.
#include "solver/bordered_solver.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "solver/block_cholesky.hpp"
#include "solver/cholmod_solver.hpp"
#include "support/box_mesh.hpp"

namespace softhand::bordered_solver_test {
namespace {

using testing::Random;

constexpr int kCore = 40;

Matrix3 random_block(Random& random) {
  return (Matrix3() << random.vector(), random.vector(), random.vector()).finished();
}

// A chain of core blocks. `idle` objects of two blocks each that nothing is coupled to, and after each of them an
// object that is coupled to some blocks of the core. The first two of these are also coupled with each other.
struct Scene {
  Scene(int idle, int coupled, std::uint64_t seed) : border(2 * (idle + coupled)) {
    BlockPattern pattern(kCore + border, border);
    for (int b = 1; b < kCore; ++b) pattern.add(b, b - 1);
    matrix = BlockMatrix(pattern);
    for (int k = 0; k < coupled; ++k) objects.push_back(kCore + 2 * (idle * (k + 1) / coupled + k));
    fill(seed);
  }
  void fill(std::uint64_t seed) {
    Random random(seed);
    matrix.set_zero();
    const auto add = [&](int row, int column, const Matrix3& block) { matrix.add(matrix.find(row, column), block); };
    for (int b = 0; b < kCore; ++b) add(b, b, 40 * Matrix3::Identity());
    for (int b = 1; b < kCore; ++b) add(b, b - 1, random_block(random));
    for (int b = kCore; b < kCore + border; ++b) add(b, b, 80 * Matrix3::Identity());
    for (const int object : objects) {
      add(object + 1, object, random_block(random));
      for (int c = 0; c < kCore; c += 9) {
        add(object, c, random_block(random));
        add(object + 1, c, random_block(random));
      }
    }
    if (objects.size() > 1) add(objects[1], objects[0], random_block(random));
  }
  int border;
  BlockMatrix matrix;
  std::vector<int> objects;
};

VectorX random_vector(Eigen::Index size, std::uint64_t seed) {
  Random random(seed);
  VectorX x(size);
  for (Eigen::Index i = 0; i < size; ++i) x[i] = random();
  return x;
}

template <typename Core>
VectorX solve(const BlockMatrix& matrix, const VectorX& rhs) {
  BorderedSolver solver(std::make_unique<Core>());
  solver.analyze(matrix);
  solver.load(matrix);
  EXPECT_TRUE(solver.factorize());
  VectorX x(rhs.size());
  solver.solve(rhs, x);
  return x;
}

TEST(BorderedSolver, AgreesWithADenseSolve) {
  for (const int idle : {0, 1, 5}) {
    for (const int coupled : {0, 1, 2, 4}) {
      if (idle + coupled == 0) continue;
      const Scene scene(idle, coupled, 7);
      const Eigen::MatrixXd dense = scene.matrix.dense();
      const VectorX rhs = random_vector(dense.rows(), 3);
      const VectorX expected = dense.llt().solve(rhs);
      SCOPED_TRACE(std::to_string(idle) + " idle, " + std::to_string(coupled) + " coupled");
      EXPECT_LE((solve<BlockCholesky<double>>(scene.matrix, rhs) - expected).norm(), 1e-13 * expected.norm());
      EXPECT_LE((solve<BlockCholesky<float>>(scene.matrix, rhs) - expected).norm(), 1e-5 * expected.norm());
      EXPECT_LE((solve<CholmodSolver>(scene.matrix, rhs) - expected).norm(), 1e-13 * expected.norm());
    }
  }
}

TEST(BorderedSolver, IdleObjectsChangeNoBitOfTheRest) {
  const Scene alone(0, 2, 7), among(24, 2, 7);
  const VectorX rhs = random_vector(alone.matrix.dense().rows(), 3);
  VectorX rhs_among = VectorX::Zero(3 * among.matrix.block_count());
  rhs_among.head(3 * kCore) = rhs.head(3 * kCore);
  for (std::size_t k = 0; k < 2; ++k) rhs_among.segment<6>(3 * among.objects[k]) = rhs.segment<6>(3 * alone.objects[k]);
  const VectorX x = solve<BlockCholesky<float>>(alone.matrix, rhs),
                x_among = solve<BlockCholesky<float>>(among.matrix, rhs_among);
  EXPECT_EQ(x.head(3 * kCore), x_among.head(3 * kCore));
  for (std::size_t k = 0; k < 2; ++k)
    EXPECT_EQ(x.segment<6>(3 * alone.objects[k]), x_among.segment<6>(3 * among.objects[k]));
}

TEST(BorderedSolver, PartialFactorisationHasTheBitsOfAWholeOne) {
  Scene scene(1, 2, 7);
  BorderedSolver solver(std::make_unique<BlockCholesky<float>>());
  solver.analyze(scene.matrix);
  solver.load(scene.matrix);
  ASSERT_TRUE(solver.factorize());
  std::vector<std::int32_t> changed;
  const auto add = [&](int row, int column) {
    const BlockSlot slot = scene.matrix.find(row, column);
    scene.matrix.add(slot, 3 * Matrix3::Identity());
    changed.push_back(slot.index);
  };
  add(4, 4);
  add(scene.objects[0], 5);
  add(scene.objects[0], scene.objects[0]);
  ASSERT_TRUE(solver.refactorize(changed));
  EXPECT_GT(solver.last_operations(), 0);
  const VectorX rhs = random_vector(3 * scene.matrix.block_count(), 3);
  VectorX x(rhs.size()), taken(rhs.size());
  solver.solve(rhs, x);
  EXPECT_EQ(x, solve<BlockCholesky<float>>(scene.matrix, rhs));
  BorderedSolver other(std::make_unique<BlockCholesky<float>>());
  other.analyze(scene.matrix);
  ASSERT_TRUE(other.take_factor(solver));
  other.solve(rhs, taken);
  EXPECT_EQ(x, taken);
}

TEST(BorderedSolver, RefusesAMatrixThatIsNotPositiveDefinite) {
  for (const bool coupled : {false, true}) {
    Scene scene(1, 1, 7);
    const int block = coupled ? scene.objects[0] : kCore;
    ASSERT_NE(block, coupled ? kCore : scene.objects[0]);
    scene.matrix.add(scene.matrix.find(block, block), -80 * Matrix3::Identity());
    BorderedSolver solver(std::make_unique<BlockCholesky<double>>());
    solver.analyze(scene.matrix);
    solver.load(scene.matrix);
    EXPECT_FALSE(solver.factorize()) << coupled;
  }
}

}  // namespace
}  // namespace softhand::bordered_solver_test
