// Factorisation and solve of a shipped hand's step in a grasp. The block factorisation in double and float is compared
// with:
// - CHOLMOD supernodal.
// - Eigen's SimplicialLDLT.
// - Eigen's conjugate gradients with an incomplete Cholesky factor.
// - The rate of dgemm.
//
// The solvers take turns, so that other load on the machine affects all of them alike. Times are the thread's own CPU
// time.
#pragma once

#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCholesky>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "bench/measure.hpp"
#include "solver/block_cholesky.hpp"
#include "solver/cholmod_solver.hpp"
#include "support/hand_matrix.hpp"

extern "C" void dgemm_(const char*, const char*, const int*, const int*, const int*, const double*, const double*,
                       const int*, const double*, const int*, const double*, double*, const int*);

namespace softhand::bench {

class FactorTurns {
 public:
  /// `size` is the number in config/hands/right_<size>.hand.json.
  explicit FactorTurns(int size)
      : matrix_(testing::hand_matrix(SOFTHAND_SOURCE_DIR "/config/hands/right_" + std::to_string(size) + ".hand.json")),
        rhs_(VectorX::Ones(3 * matrix_.block_count())),
        x_(rhs_.size()) {
    analysis_ = seconds_of([&] { block_.analyze(matrix_); });
    single_.analyze(matrix_);
    cholmod_.analyze(matrix_);
    std::vector<Eigen::Triplet<double>> entries;
    for (int column = 0; column < matrix_.block_count(); ++column) {
      for (std::int32_t k = matrix_.column_start()[static_cast<std::size_t>(column)];
           k < matrix_.column_start()[static_cast<std::size_t>(column) + 1]; ++k) {
        const int row = matrix_.row()[static_cast<std::size_t>(k)];
        for (int i = 0; i < 9; ++i) {
          const double value = matrix_.values()[static_cast<std::size_t>(9 * k + i)];
          entries.emplace_back(3 * row + i % 3, 3 * column + i / 3, value);
          if (row != column) entries.emplace_back(3 * column + i / 3, 3 * row + i % 3, value);
        }
      }
    }
    sparse_.resize(rhs_.size(), rhs_.size());
    sparse_.setFromTriplets(entries.begin(), entries.end());
    eigen_.analyzePattern(sparse_);
    gradients_.setTolerance(1e-4);
    gradients_.analyzePattern(sparse_);
  }

  /// Runs each solver once. Conjugate gradients run only on request, because they are slow.
  void turn(bool with_conjugate_gradients) {
    time(block_, block_times_);
    solve_times_.push_back(seconds_of([&] { block_.solve(rhs_, x_); }));
    time(single_, single_times_);
    time(cholmod_, cholmod_times_);
    eigen_times_.push_back(seconds_of([&] {
      eigen_.factorize(sparse_);
      x_ = eigen_.solve(rhs_);
    }));
    if (with_conjugate_gradients) {
      gradients_times_.push_back(seconds_of([&] {
        gradients_.factorize(sparse_);
        x_ = gradients_.solve(rhs_);
      }));
    }
    dgemm_times_.push_back(seconds_of([&] {
      const double one = 1, zero = 0;
      dgemm_("N", "N", &kSize, &kSize, &kSize, &one, a_.data(), &kSize, a_.data(), &kSize, &zero, c_.data(), &kSize);
    }));
  }

  // Medians over the turns so far, s. A time covers loading of the values, factorisation and one solve.
  double block() const { return median(block_times_); }
  double block_solve() const { return median(solve_times_); }
  double single() const { return median(single_times_); }
  double cholmod() const { return median(cholmod_times_); }
  double eigen() const { return median(eigen_times_); }
  /// The iteration stops at a residual of 1e-4 of the right-hand side.
  double conjugate_gradients() const { return median(gradients_times_); }
  long gradients_iterations() const { return gradients_.iterations(); }
  /// Rate of the double factorisation over dgemm's rate. The time includes loading of the values.
  double fraction_of_peak() const { return block_.factor_operations() / (block() - block_solve()) / dgemm_rate(); }
  /// Floating-point operations per second.
  double dgemm_rate() const { return 2.0 * kSize * kSize * kSize / median(dgemm_times_); }
  double operations() const { return block_.factor_operations(); }
  double analysis() const { return analysis_; }
  std::size_t front_count() const { return block_.front_count(); }

 private:
  static constexpr int kSize = 384;

  void time(LinearSolver& solver, std::vector<double>& times) {
    // Runs twice and keeps the second time, because the previous solver filled the caches with its own data.
    for (int run = 0; run < 2; ++run) {
      const double taken = seconds_of([&] {
        solver.load(matrix_);
        if (!solver.factorize()) throw std::runtime_error("the step's matrix is not positive definite");
        solver.solve(rhs_, x_);
      });
      if (run == 1) times.push_back(taken);
    }
  }

  BlockMatrix matrix_;
  VectorX rhs_, x_;
  BlockCholesky<double> block_;
  BlockCholesky<float> single_;
  CholmodSolver cholmod_;
  Eigen::SparseMatrix<double> sparse_;
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> eigen_;
  Eigen::ConjugateGradient<Eigen::SparseMatrix<double>, Eigen::Lower | Eigen::Upper, Eigen::IncompleteCholesky<double>>
      gradients_;
  double analysis_ = 0;
  std::vector<double> a_ = std::vector<double>(kSize * kSize, 1.0), c_ = std::vector<double>(kSize * kSize);
  std::vector<double> block_times_, solve_times_, single_times_, cholmod_times_, eigen_times_, gradients_times_,
      dgemm_times_;
};

}  // namespace softhand::bench
