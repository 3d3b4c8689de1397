// The factor of the Hessian: in float with a fallback in double, or in double, or of another linear solver.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "solver/bordered_solver.hpp"
#include "solver/incremental_potential.hpp"

namespace softhand {

class HessianFactor {
 public:
  /// Analyses the pattern of `hessian`.
  HessianFactor(const SolverOptions& options, const BlockMatrix& hessian);

  /// Makes a new factor of the potential's Hessian, in double if `in_double` or if the float factor fails. An exact
  /// Hessian that is not positive definite is evaluated again at `state`, projected. After this, shifts of the diagonal
  /// are tried. Returns false if all fail. `without_kinks`: takes the terms with kinks back from the Hessian. The
  /// factor keeps only what they add to the core (`kept_kinks`).
  bool renew(IncrementalPotential& potential, const State& state, bool in_double, bool without_kinks, StepMeter& meter);
  /// Renews only the terms with kinks, at `state`, and the fronts above their blocks. Requires `is_of`. Returns false
  /// if these terms hardly changed or if the sum is not positive definite. Then the whole Hessian must be renewed.
  bool renew_kinks(IncrementalPotential& potential, const State& state, StepMeter& meter);
  void solve(const VectorX& rhs, VectorX& x, StepMeter& meter);
  /// The linear solver with the last factor. The caller counts the work.
  BorderedSolver& linear_solver() { return *last_; }
  /// Whether the linear solver has half solves.
  bool has_halves() const { return has_halves_; }
  /// The last factor is of the Hessian without terms with kinks, except for `kept_kinks`, and without a shift.
  bool is_without_kinks() const { return without_kinks_; }
  /// Compressed tissue is stable only with its contacts. So the factor holds their blocks between nodes, as they were
  /// then. It holds no coupling with the border.
  std::span<const KeptBlock> kept_kinks() const { return kept_kinks_; }

  /// Whether this is the factor of the potential's Hessian as it is now, without a shift.
  bool is_of(const IncrementalPotential& potential) const { return version_ == potential.version(); }
  /// No other factor would be more precise.
  bool is_most_precise() const { return !precise_ || last_ == precise_.get(); }
  /// The factor is the fallback in double.
  bool is_fallback() const { return last_ == precise_.get(); }
  /// Floating-point operations of a whole factorisation, and the count of numbers in the factor.
  double operations() const { return solver_->factor_operations(); }
  double entries() const { return solver_->factor_entries(); }

  /// As after construction: there is no factor.
  void forget() {
    last_ = solver_.get();
    version_ = 0;
    without_kinks_ = false;
  }
  /// Takes over the factor of `other`, which was made of the same pattern. Returns false and does nothing if the linear
  /// solvers differ in kind.
  bool take_over(const HessianFactor& other);

 private:
  void count_work(StepMeter& meter) const;
  void keep_kinks(BlockMatrix& hessian, bool is_new);

  bool has_halves_;
  bool without_kinks_ = false;
  std::vector<KeptBlock> kept_kinks_;
  std::unique_ptr<BorderedSolver> solver_;
  std::unique_ptr<BorderedSolver> precise_;  // fallback in double for a float factor; else null
  BorderedSolver* last_ = nullptr;           // the one of these two that holds the last factor
  std::uint64_t version_ = 0;                // of the factorised Hessian; 0: it was shifted, or there is no factor
};

}  // namespace softhand
