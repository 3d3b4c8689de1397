#include "solver/hessian_factor.hpp"

#include <utility>

#include "solver/block_cholesky.hpp"
#include "solver/bordered_solver.hpp"

namespace softhand {
namespace {

constexpr int kMaxShifts = 8;
constexpr double kFirstShift = 1e-4;  // fraction of the diagonal entry; each retry has ten times more

}  // namespace

HessianFactor::HessianFactor(const SolverOptions& options, const BlockMatrix& hessian)
    : has_halves_(!options.linear_solver) {
  const auto bordered = [](std::unique_ptr<LinearSolver> core) {
    return std::make_unique<BorderedSolver>(std::move(core));
  };
  const auto in_double = [&] {
    return bordered(std::make_unique<BlockCholesky<double>>(widest_instruction_set(), options.helper));
  };
  if (options.linear_solver) {
    solver_ = bordered(options.linear_solver());
  } else if (options.factor == "float") {
    solver_ = bordered(std::make_unique<BlockCholesky<float>>(widest_instruction_set(), options.helper));
    precise_ = in_double();
    precise_->analyze(hessian);
  } else {
    solver_ = in_double();
  }
  solver_->analyze(hessian);
  last_ = solver_.get();
  kept_kinks_.reserve(static_cast<std::size_t>(hessian.stored_blocks()));
}

bool HessianFactor::renew(IncrementalPotential& potential, const State& state, bool in_double, bool without_kinks,
                          StepMeter& meter) {
  ++meter.report.factorisations;
  version_ = 0;
  without_kinks_ = false;
  double shift = 0;
  last_ = in_double && precise_ ? precise_.get() : solver_.get();
  kept_kinks_.clear();
  bool has_kinks = true;  // the Hessian has all terms with kinks
  for (int attempt = 0; attempt <= kMaxShifts;) {
    {
      const auto timer = meter.time(&StepTiming::assembly);
      if (without_kinks) keep_kinks(potential.change_hessian(), std::exchange(has_kinks, false));
      last_->load(potential.hessian());
    }
    bool positive = false;
    {
      const auto timer = meter.time(&StepTiming::factorisation);
      positive = last_->factorize();
    }
    count_work(meter);
    if (without_kinks) potential.change_hessian().take_back();
    if (positive) {
      if (is_fallback()) ++meter.report.double_factors;
      without_kinks_ = without_kinks && shift == 0 && !last_->is_coupled();
      if (shift == 0 && !without_kinks) version_ = potential.version();
      return true;
    }
    if (potential.project_hessian(state, meter)) {
      has_kinks = true;
      continue;
    }
    if (!is_most_precise()) {
      // The matrix may still be positive definite in double.
      last_ = precise_.get();
      continue;
    }
    const auto timer = meter.time(&StepTiming::assembly);
    const double next = attempt++ == 0 ? kFirstShift : 10.0 * shift;
    potential.shift_diagonal(next - shift);
    shift = next;
    ++meter.report.shifts;
  }
  return false;
}

// Replaces the terms with kinks by `kept_kinks_`, which becomes the part between blocks of the core if `is_new`. The
// journal of `hessian` then holds this part.
void HessianFactor::keep_kinks(BlockMatrix& hessian, bool is_new) {
  if (is_new) {
    kept_kinks_.clear();
    for (std::size_t k = 0; k < hessian.journal().size(); ++k) {
      const std::int32_t stored = hessian.journal()[k];
      if (hessian.is_core(stored)) kept_kinks_.push_back({stored, hessian.added(k)});
    }
    hessian.take_back();
  }
  for (const KeptBlock& kept : kept_kinks_) hessian.add({kept.stored, false}, kept.value);
}

bool HessianFactor::renew_kinks(IncrementalPotential& potential, const State& state, StepMeter& meter) {
  if (!potential.renew_kinks(state, meter)) return false;
  const auto timer = meter.time(&StepTiming::factorisation);
  ++meter.report.factorisations;
  ++meter.report.kink_factors;
  last_->load(potential.hessian());
  const bool positive = last_->refactorize(potential.changed_blocks());
  count_work(meter);
  version_ = positive ? potential.version() : 0;
  return positive;
}

void HessianFactor::solve(const VectorX& rhs, VectorX& x, StepMeter& meter) {
  last_->solve(rhs, x);
  meter.report.work += meter.prices.solve;
}

void HessianFactor::count_work(StepMeter& meter) const {
  meter.report.work +=
      meter.prices.per_operation * last_->last_operations() * (is_fallback() ? meter.prices.per_double : 1.0);
}

bool HessianFactor::take_over(const HessianFactor& other) {
  BorderedSolver* const mine = other.is_fallback() ? precise_.get() : solver_.get();
  if (mine == nullptr || !mine->take_factor(*other.last_)) return false;
  last_ = mine;
  version_ = other.version_;
  without_kinks_ = other.without_kinks_;
  kept_kinks_ = other.kept_kinks_;
  return true;
}

}  // namespace softhand
