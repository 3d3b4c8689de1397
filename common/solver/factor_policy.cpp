#include "solver/factor_policy.hpp"

#include <algorithm>
#include <cmath>

namespace softhand {
namespace {

// This many iterations with a reused factor cost as much as one iteration with a new Hessian and factor.
constexpr double kEquivalentIterationsProjected = 8;
constexpr double kEquivalentIterationsExact = 4;  // the same if the new Hessian is exact: then it converges faster
constexpr double kKinkFraction = 0.6;             // expected cost of renewing contact and friction, in whole factors
constexpr int kMaxConsecutiveKinkFactors = 2;     // after this many, the rest of the Hessian may be stale
constexpr double kSlowest = 0.9;  // cap on the ratio of two increments when the remaining movement is estimated
// Scale of an iteration. The contacts of a condensed iteration are known. If it ends short nevertheless, friction has
// changed, and a new factor would not help. A factor that is much too stiff or too soft does worse.
constexpr double kShortest = 0.4;
constexpr double kStalled = 0.5;  // ratio of two residuals
// A step that was cut off is near the minimum if its estimated remaining movement (m) is below this.
constexpr double kNearMinimum = 2.5e-4;
// And if no node is faster, m/s. In a fist that closes fast, the estimates of truncated steps are wrong.
constexpr double kSlow = 0.2;
// Or if its residual (N, N m) is below this and no node is faster (m/s).
constexpr double kBalanced = 0.3, kFast = 0.5;
// Condensed iterations may take this work (fast steps) beyond the budget. They gain nothing above this residual (N,
// N m): there, contact alone is solved instead.
constexpr double kOverrun = 0.9;
constexpr double kCalm = 10;
// A condensed iteration with a new Hessian and factor may end this work (fast steps) beyond the budget. It does so only
// above this residual (N, N m). Below it, iterations with the last factor gain as much for the same work.
constexpr double kWholeOverrun = 1.2;
constexpr double kFarResidual = 1;

// The number of iterations until `now` falls to `tolerance` at this contraction.
double iterations_until(double now, double tolerance, double contraction) {
  if (now <= tolerance) return 0;
  return contraction < 1 ? std::log(tolerance / now) / std::log(contraction) : std::numeric_limits<double>::infinity();
}

bool has_whole_factor(const StepReport& report) { return report.factorisations > report.kink_factors; }

}  // namespace

FactorPolicy::FactorPolicy(const SolverOptions& options, const StepWork& prices)
    : options_(options),
      may_condense_(options.keep_factor && options.line_search && options.max_iterations >= kFewIterations),
      equivalent_iterations_(tries_exact(options) ? kEquivalentIterationsExact : kEquivalentIterationsProjected),
      evaluation_work_(prices.evaluation),
      contact_work_(prices.contact_blocks),
      reuse_work_(prices.solve + prices.evaluation),
      kinks_work_(prices.contact_blocks + kKinkFraction * prices.whole_factor + reuse_work_),
      whole_work_(prices.linearisation + prices.whole_factor + reuse_work_) {}

void FactorPolicy::begin_step(double time_step, bool has_factor, bool touches) {
  may_reuse_ = may_condense_ && !carried_.was_cut_off_far;
  has_factor_ = has_factor;
  is_first_ = true;
  is_revised_ = false;
  reuses_ = may_reuse_ && (carried_.time_step == time_step || has_factor);
  carried_.time_step = 0;
  in_double_ = needs_double_ = false;
  double_helps_ = true;
  consecutive_kinks_ = reuses_ ? 0 : kMaxConsecutiveKinkFactors;
  reserved_ = touches ? contact_work_ + evaluation_work_ : 0.0;
  last_move_ = contraction_ = 0;
  remaining_move_ = estimated_move_ = std::numeric_limits<double>::infinity();
}

bool FactorPolicy::exceeds_overrun(const StepReport& report) const {
  return options_.work_budget > 0 && report.work > options_.work_budget + kOverrun;
}

bool FactorPolicy::is_balanced(const StepReport& report) { return report.residual <= kBalanced; }

double FactorPolicy::remaining_work(const StepReport& report) const {
  return options_.work_budget > 0 ? options_.work_budget - reserved_ - report.work
                                  : std::numeric_limits<double>::infinity();
}

FactorPolicy::Decision FactorPolicy::decide(const StepReport& report, bool can_renew_kinks, bool condenses) const {
  bool renews = !reuses_;
  bool renews_kinks =
      renews && may_reuse_ && can_renew_kinks && consecutive_kinks_ < kMaxConsecutiveKinkFactors && !in_double_;
  bool stops = false;
  if (const double remaining = remaining_work(report); report.iterations > 0 && std::isfinite(remaining)) {
    // A new Hessian and factor gains most. So its work is reserved until the step has had one. After that, all
    // remaining work may be spent.
    const bool has_whole = has_whole_factor(report);
    const double reserve = has_whole ? 0.0 : whole_work_;
    const double whole_overrun = condenses && saves_hessians() && report.residual > kFarResidual ? kWholeOverrun : 0.0;
    const bool affords_whole = remaining + whole_overrun >= whole_work_;
    if (!renews && !has_whole && affords_whole && remaining - reuse_work_ < whole_work_ &&
        iterations_until(remaining_move_, 1, contraction_) * reuse_work_ > remaining)
      renews = true;
    if (renews_kinks && remaining < kinks_work_ + reserve) renews_kinks = !affords_whole && remaining >= kinks_work_;
    if (renews && !renews_kinks && !affords_whole) renews = false;
    // If a chord step did not factorise in this step, its factor is not usable here.
    // The direction of a factor without the contacts of a revision would go into the object.
    const double overrun = condenses && report.residual <= kCalm ? kOverrun : 0.0;
    stops = !renews && (remaining + overrun < reuse_work_ || !has_factor_ || is_revised_);
  }
  return {.stops = stops,
          .renewal = renews_kinks ? Renewal::kinks
                     : renews     ? Renewal::whole
                                  : Renewal::none,
          .in_double = in_double_};
}

bool FactorPolicy::improve(Decision& decision, bool is_most_precise, const StepReport& report) {
  const bool was_whole = decision.renewal == Renewal::whole;
  if (was_whole && is_most_precise) return false;
  if (!is_first_ && !affords_whole_factor(report)) return false;
  if (was_whole) in_double_ = needs_double_ = true;
  decision.renewal = Renewal::whole;
  decision.in_double = in_double_;
  return true;
}

void FactorPolicy::learn(const Decision& decision, const Iteration& iteration, const StepReport& report) {
  // With one factor, the increments shrink by a constant ratio. For a new factor, only the residual shows the
  // contraction. After a move beyond the full step, too, only the residual shows it.
  const double of_residual = iteration.residual_before > 0 ? report.residual / iteration.residual_before : 0.0;
  const bool shows_ratio = decision.renewal == Renewal::none && last_move_ > 0 && iteration.scale <= 1;
  contraction_ = shows_ratio ? iteration.move / last_move_ : of_residual;
  remaining_move_ = std::min(contraction_, kSlowest) / (1 - std::min(contraction_, kSlowest)) * iteration.move;
  estimated_move_ = remaining_move_ * std::max(options_.movement_tolerance, std::numeric_limits<double>::min());
  last_move_ = iteration.scale <= 1 ? iteration.move : 0;
  const bool is_full = iteration.scale == 1;
  reuses_ = may_reuse_ && iteration.scale >= (iteration.condenses ? kShortest : 1.0) &&
            std::max(iterations_until(report.residual, options_.residual_tolerance, of_residual),
                     iterations_until(remaining_move_, 1, contraction_)) <= equivalent_iterations_;
  consecutive_kinks_ = decision.renewal == Renewal::kinks ? consecutive_kinks_ + 1 : 0;
  if (decision.renewal == Renewal::whole && is_full && iteration.measured && !iteration.condenses &&
      report.residual > kStalled * iteration.residual_before) {
    double_helps_ = double_helps_ && !in_double_;
    in_double_ = needs_double_ || double_helps_;
  }
  is_first_ = false;
  has_factor_ = true;
  is_revised_ = false;
}

void FactorPolicy::start_again(bool keeps_factor) {
  is_revised_ = !keeps_factor;
  reuses_ = reuses_ && keeps_factor;
  last_move_ = 0;
  remaining_move_ = std::numeric_limits<double>::infinity();
}

bool FactorPolicy::has_converged(const StepReport& report) const {
  return options_.max_iterations > 1 && report.residual <= options_.residual_tolerance && remaining_move_ <= 1;
}

void FactorPolicy::end_step(double time_step, double fastest, const StepReport& report) {
  // A failed step has no factor to reuse. A step that was cut off far from the minimum has none either: its
  // Hessian is too old there.
  const bool is_near = (fastest < kSlow && estimated_move_ < kNearMinimum) ||
                       (fastest < kFast && report.measured && is_balanced(report));
  carried_.was_cut_off_far = report.status == StepStatus::budget_spent && !is_near;
  const bool is_reusable = report.status != StepStatus::failed_factorisation && !carried_.was_cut_off_far;
  if (is_reusable && (reuses_ || has_whole_factor(report))) carried_.time_step = time_step;
}

}  // namespace softhand
