// The limited-memory correction against the dense formula of BFGS, and what it saves.
#include "solver/bfgs_correction.hpp"

#include <gtest/gtest.h>

#include <deque>
#include <random>
#include <utility>

#include "solver/newton_solver.hpp"
#include "support/count_allocations.hpp"

namespace softhand::bfgs_correction_test {
namespace {

using Matrix = Eigen::MatrixXd;

Matrix random_definite(Eigen::Index size, std::mt19937& random) {
  std::normal_distribution<double> normal;
  Matrix root(size, size);
  for (Eigen::Index k = 0; k < root.size(); ++k) root(k) = normal(random);
  return root * root.transpose() + Matrix::Identity(size, size);
}

// A quadratic energy, and the factor of another one.
struct Quadratic {
  explicit Quadratic(unsigned seed) {
    std::mt19937 random(seed);
    hessian = random_definite(kSize, random);
    inverse_factor = random_definite(kSize, random).inverse();
    std::normal_distribution<double> normal;
    for (Eigen::Index k = 0; k < kSize; ++k) at[k] = normal(random);
  }
  VectorX gradient() const { return hessian * at; }

  static constexpr int kNodes = 5;
  static constexpr Eigen::Index kSize = 3 * kNodes;
  Matrix hessian, inverse_factor;
  VectorX at = VectorX::Zero(kSize);
};

// Fletcher's formula: F^-1 := (1 - s y'/s'y) F^-1 (1 - y s'/s'y) + s s'/s'y.
Matrix updated(const Matrix& inverse, const VectorX& move, const VectorX& gradient_change) {
  const double curvature = move.dot(gradient_change);
  const Matrix one = Matrix::Identity(move.size(), move.size());
  const Matrix left = one - move * gradient_change.transpose() / curvature;
  return left * inverse * left.transpose() + move * move.transpose() / curvature;
}

TEST(BfgsCorrection, AgreesWithTheDenseFormulaOfTheLastFourMoves) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    Quadratic energy(seed);
    BfgsCorrection correction(DofLayout{.node_count = Quadratic::kNodes});
    std::deque<std::pair<VectorX, VectorX>> moves;
    for (int iteration = 0; iteration < 8; ++iteration) {
      Matrix inverse = energy.inverse_factor;
      for (const auto& [move, change] : moves) inverse = updated(inverse, move, change);
      const VectorX gradient = energy.gradient(), expected = -inverse * gradient;
      VectorX direction = -energy.inverse_factor * gradient;
      EXPECT_EQ(correction.correct(gradient, direction), iteration > 0);
      EXPECT_LE((direction - expected).norm(), 1e-9 * expected.norm()) << "iteration " << iteration;
      const double scale = iteration % 2 == 0 ? 0.5 : 0.25;
      correction.add_move(direction, scale);
      moves.emplace_back(scale * direction, energy.hessian * (scale * direction));
      if (moves.size() > 4) moves.pop_front();
      energy.at += scale * direction;
    }
  }
}

TEST(BfgsCorrection, ForgetsMoves) {
  Quadratic energy(1);
  BfgsCorrection correction(DofLayout{.node_count = Quadratic::kNodes});
  for (int iteration = 0; iteration < 3; ++iteration) {
    const VectorX plain = -energy.inverse_factor * energy.gradient();
    VectorX direction = plain;
    EXPECT_FALSE(correction.correct(energy.gradient(), direction));
    EXPECT_EQ(direction, plain);
    correction.add_move(direction, 0.1);
    energy.at += 0.1 * direction;
    correction.clear();
  }
}

// Along a move where the energy is concave, BFGS has no correction.
TEST(BfgsCorrection, LeavesOutMovesWithNegativeCurvature) {
  Quadratic energy(2);
  energy.hessian = -energy.hessian;
  BfgsCorrection correction(DofLayout{.node_count = Quadratic::kNodes});
  for (int iteration = 0; iteration < 3; ++iteration) {
    VectorX direction = -energy.inverse_factor * energy.gradient();
    EXPECT_FALSE(correction.correct(energy.gradient(), direction));
    correction.add_move(direction, 0.1);
    energy.at += 0.1 * direction;
  }
}

TEST(BfgsCorrection, AllocatesNothing) {
  Quadratic energy(3);
  BfgsCorrection correction(DofLayout{.node_count = Quadratic::kNodes});
  VectorX gradient = energy.gradient(), direction = -energy.inverse_factor * gradient;
  counting = true;
  for (int iteration = 0; iteration < 6; ++iteration) {
    correction.correct(gradient, direction);
    correction.add_move(direction, 0.5);
    gradient *= 0.5;
    direction *= 0.6;
  }
  counting = false;
  EXPECT_EQ(std::exchange(allocations, 0), 0);
}

// A spring to the origin whose stiffness may change between steps.
class Spring final : public Energy {
 public:
  Vector3 stiffness = Vector3::Constant(100);  // N/m, along the axes

  std::string_view name() const override { return "spring"; }
  int needed_bodies() const override { return 0; }
  void add_pattern(BlockPattern& pattern) const override { pattern.add(0, 0); }
  void bind(const BlockMatrix& matrix) override { slot_ = matrix.find(0, 0); }
  double value(const State& state) const override {
    return 0.5 * stiffness.dot(state.node_positions.col(0).cwiseAbs2());
  }
  double add_gradient(const State& state, VectorX& gradient) const override {
    gradient.head<3>() += stiffness.cwiseProduct(state.node_positions.col(0));
    return value(state);
  }
  void add_hessian(const State&, BlockMatrix& hessian, Curvature) const override {
    hessian.add(slot_, Matrix3(stiffness.asDiagonal()));
  }

 private:
  BlockSlot slot_;
};

// The factor of the first step is a tenth wrong in the second one. Without a correction each iteration leaves a tenth
// of the residual, and the step takes four iterations.
TEST(NewtonSolver, AnOldFactorIsCorrectedAfterTheStiffnessHasChanged) {
  Spring spring;
  State state;
  state.node_positions = Vector3(0.01, 0.02, 0.03);
  state.node_velocities = Vector3::Zero();
  SolverOptions options;
  options.residual_tolerance = 1e-5;
  NewtonSolver solver({&spring}, state.layout(), options);
  EXPECT_EQ(solver.step(state, 0.01).factorisations, 1);
  spring.stiffness = {90, 110, 92};
  state.node_positions = Vector3(0.001, -0.002, 0.0015);
  const StepReport report = solver.step(state, 0.01);
  EXPECT_EQ(report.status, StepStatus::converged);
  EXPECT_EQ(report.factorisations, 0);
  EXPECT_LE(report.iterations, 3);
}

}  // namespace
}  // namespace softhand::bfgs_correction_test
