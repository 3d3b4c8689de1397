#include "solver/predictor.hpp"

#include <algorithm>
#include <limits>
#include <utility>

namespace softhand {
namespace {

constexpr int kMaxPredictions = 6;
// Ratio of two increments. Above it, a new factor costs less than the iterations that it saves.
constexpr double kSlowContraction = 0.15;
constexpr double kStalledPrediction = 0.5;  // ratio of two increments, or of two residuals
constexpr double kFarPrediction = 1.5;      // ratio of two residuals: from a state so far off, chord steps fail
// Largest movement of a node or bone over the tolerance of the RMS. One node of 1,450 could otherwise move 38
// tolerances.
constexpr double kLargest = 7;
constexpr double kNoEnergy = 1e-12;    // J, 1 mN over 1 nm: smaller energy differences are rounding errors
constexpr double kPredictable = 2e-3;  // m, RMS of the bones: if the prediction error is larger, chord steps fail

}  // namespace

Predictor::Predictor(const SolverOptions& options, DofLayout layout)
    : work_budget_(options.work_budget),
      tolerance_(options.chord_tolerance),
      residual_tolerance_(options.residual_tolerance),
      lowest_(empty_state(layout)) {
  carried_.gradient = carried_.earlier_gradient = extrapolated_ = pull_ = direction_ =
      VectorX::Zero(layout.dof_count());
}

Predictor::Outcome Predictor::step(State& state, double time_step, IncrementalPotential& potential,
                                   HessianFactor& factor, Linkage& linkage, StepMeter& meter) {
  StepReport& report = meter.report;
  const StepWork& prices = meter.prices;
  potential.measure_start(state, report);
  bool renews = carried_.contracts_slowly || carried_.factor_time_step != time_step;
  const bool has_potentials = potential.knows_potentials_at(state);
  const bool extrapolates = has_potentials && carried_.gradient_time_step == time_step && !renews;
  if (has_potentials) {
    carried_.earlier_gradient.swap(carried_.gradient);
    carried_.gradient = potential.node_gradient();
    linkage.to_bodies(state, carried_.gradient);
  }
  carried_.gradient_time_step = has_potentials ? time_step : 0;
  // The least energy so far. It includes the start, from which an ordinary step would descend, and the predicted state,
  // if these are evaluated.
  double least = std::numeric_limits<double>::infinity();
  // The energy of `lowest_`. If the energy of the start is unknown, no state is known to lie below it.
  double lowest = -std::numeric_limits<double>::infinity();
  bool fell_below_start = false;
  const auto note_lowest = [&] {
    if (!(report.energy < lowest)) return;
    lowest = report.energy;
    lowest_ = state;
    fell_below_start = true;
  };
  const auto give_up = [&] {
    state = fell_below_start ? lowest_ : potential.start();
    return fell_below_start ? Outcome::lowered : Outcome::failed;
  };
  if (has_potentials) {
    if (!potential.evaluate(state, meter, {.may_be_result = false})) return give_up();
    for (std::size_t t = 0; t < report.term_count; ++t) report.terms[t].start = report.terms[t].joules;
    least = lowest = report.energy;
  }
  linkage.coast(state, time_step);
  if (extrapolates) {
    extrapolated_ = 2 * carried_.gradient - carried_.earlier_gradient;
    linkage.to_world(state, extrapolated_);
  }
  if (!potential.evaluate(
          state, meter,
          {.hessian = renews, .may_be_result = false, .node_gradient = extrapolates ? &extrapolated_ : nullptr})) {
    return give_up();
  }
  if (!extrapolates) {
    least = std::min(least, report.energy);
    note_lowest();
  }
  double before = 0;
  bool has_new_factor = false;  // of this step
  const double iteration_work = prices.solve + prices.evaluation;
  for (int iteration = 0; iteration < kMaxPredictions; ++iteration) {
    if (work_budget_ > 0 && report.work + iteration_work + (renews ? prices.whole_factor : 0.0) > work_budget_)
      return give_up();
    if (renews) {
      if (!factor.renew(potential, state, false, false, meter) || report.shifts > 0) return give_up();
      linkage.set_earlier_state(state);
      carried_.factor_time_step = time_step;
    }
    {
      const auto timer = meter.time(&StepTiming::solve);
      pull_ = -potential.gradient();
      linkage.set_later_state(state);
      linkage.to_then(pull_);
      factor.solve(pull_, direction_, meter);
      linkage.to_now(direction_);
    }
    if (!direction_.allFinite()) return give_up();
    linkage.move(state, direction_, 1);
    ++report.iterations;
    report.increment = direction_.lpNorm<Eigen::Infinity>();
    const double moved = linkage.root_mean_square(direction_);
    has_new_factor = has_new_factor || renews;
    const bool stalled = iteration > 0 && has_new_factor && moved > kStalledPrediction * before;
    carried_.contracts_slowly =
        iteration > 0 ? moved > kSlowContraction * before : carried_.contracts_slowly && !renews;
    const bool moved_little = moved <= tolerance_ && linkage.largest_move(direction_) <= kLargest * tolerance_;
    const bool renewed = std::exchange(renews, !moved_little && carried_.contracts_slowly && !stalled);
    const double residual = report.residual;
    if (!potential.evaluate(state, meter, {.hessian = renews, .may_be_result = moved_little})) return give_up();
    // Small increments can raise the energy much if the reused factor lacks a stiffness, such as that beyond a strain
    // limit.
    const bool fell = report.energy <= least + report.rounding() + kNoEnergy;
    least = std::min(least, report.energy);
    note_lowest();
    // With a factor that is much too stiff the increments are small, however large the residual is.
    const bool shrank = report.residual <= std::max(residual_tolerance_, kStalledPrediction * residual);
    const bool is_far = report.residual > std::max(residual_tolerance_, kFarPrediction * residual);
    if (stalled || is_far || (!shrank && has_new_factor && !renewed)) return give_up();
    if (moved_little && fell && shrank) return Outcome::converged;
    before = moved;
    if (!shrank && !has_new_factor && !renews) {
      renews = true;
      before = std::numeric_limits<double>::infinity();  // not comparable with the increments of a better factor
      if (!potential.evaluate(state, meter, {.hessian = true, .may_be_result = false})) return give_up();
    }
  }
  return give_up();
}

void Predictor::end_step(const State& start, const State& end, double time_step, const Linkage& linkage) {
  carried_.is_predictable = linkage.prediction_error(start, end, time_step) <= kPredictable;
}

}  // namespace softhand
