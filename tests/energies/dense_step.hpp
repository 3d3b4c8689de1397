// A backward-Euler step for tests of terms without the solver: dense Newton on the incremental potential.
#pragma once

#include <vector>

#include "energies/derivative_suite.hpp"

namespace softhand::testing {

class DenseStepper {
 public:
  /// The terms must outlive the stepper. Inertia must be one of them.
  DenseStepper(std::vector<Energy*> terms, const State& state) : terms_(std::move(terms)) {
    BlockPattern pattern(state.layout().block_count());
    for (const Energy* term : terms_) term->add_pattern(pattern);
    matrix_ = BlockMatrix(pattern);
    for (Energy* term : terms_) term->bind(matrix_);
  }

  /// Newton with the projected Hessian and halved steps, until the increment is below `tolerance` (m, rad). Returns the
  /// number of iterations.
  int step(State& state, double time_step, double tolerance = 1e-12, int most_iterations = 50) {
    for (Energy* term : terms_) term->begin_step(state, time_step);
    int iteration = 0;
    for (; iteration < most_iterations; ++iteration) {
      matrix_.set_zero();
      VectorX gradient = VectorX::Zero(state.layout().dof_count());
      double value = 0;
      for (const Energy* term : terms_) value += term->add_all(state, gradient, matrix_, Curvature::projected);
      const VectorX increment = -matrix_.dense().ldlt().solve(gradient);
      State trial = state;
      apply_increment(trial, increment);
      for (double scale = 0.5; energy(trial) > value + 1e-12 * std::abs(value) && scale > 1e-3; scale *= 0.5) {
        trial = state;
        apply_increment(trial, increment, scale);
      }
      state = trial;
      if (increment.lpNorm<Eigen::Infinity>() < tolerance) break;
    }
    for (Energy* term : terms_) term->end_step(state);
    return iteration;
  }

 private:
  double energy(const State& state) const {
    double sum = 0;
    for (const Energy* term : terms_) sum += term->value(state);
    return sum;
  }

  std::vector<Energy*> terms_;
  BlockMatrix matrix_;
};

}  // namespace softhand::testing
