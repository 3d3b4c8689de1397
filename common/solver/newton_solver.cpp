#include "solver/newton_solver.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <utility>

namespace softhand {
namespace {

// m. If a body moves less than kFullMove in the step, its tolerance shrinks in proportion. The tolerance stops
// shrinking at a movement of kLeastMove.
constexpr double kFullMove = 0.05;
// The same for bodies that contact or the tracker holds: their errors do not add up from step to step.
constexpr double kFullMoveHeld = 5e-4;
constexpr double kLeastMove = 1e-5;
// Usual ratio of the residuals after and before an iteration. It only decides whether the Hessian is computed together
// with the next gradient.
constexpr double kUsualReduction = 0.01;
constexpr double kShortStep = 0.2;  // scale of an iteration: if it is shorter, all further moves are straight
constexpr int kMaxRevisions = 4;    // of the terms in a step
// m, rad. Contact points lie 2 mm apart. What has moved further since the terms last changed may have passed a surface
// without a contact. Without this contact the minimum is elsewhere. The first iteration does not count, because its
// contacts are predicted.
constexpr double kFarMove = 3e-3;
// A state with less than this fraction of the energy of another one is much nearer to the minimum.
constexpr double kMuchLess = 0.5;
// A step that has not converged after so many iterations may never do so. Its terms are revised nevertheless.
constexpr std::int64_t kLateIteration = 15;
// Tolerance of the condensed solve of contact, as a fraction of `residual_tolerance`.
constexpr double kContactTolerance = 0.1;
// Residual (N, N m) below which the terms are revised for the first time.
constexpr double kRough = 0.03;
// m, RMS of the bones: if velocities miss the guess by more, they do not predict its contacts either.
constexpr double kWellPredicted = 1e-3;
// If the touched blocks fill at most this part of the room of the condensed model, the next step with a budget uses it
// again.
constexpr double kRoomy = 0.9;
// Nodes are relieved if the residual force of one is above this (N), and above this fraction of the largest residual.
// If bodies are much further out of balance, the next iteration moves the nodes again.
constexpr double kLeastRelief = 0.02, kDominant = 0.3;
constexpr int kContactSolves = 3;     // after a step that did not converge
constexpr double kContactWork = 0.3;  // fast steps that each of them may take even if no budget remains

double steady_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

const SolverOptions& checked(const SolverOptions& options) {
  check(options);
  return options;
}

bool fits(const State& state, DofLayout layout) {
  return state.node_positions.cols() == layout.node_count && state.node_velocities.cols() == layout.node_count &&
         state.body_poses.size() == static_cast<std::size_t>(layout.body_count) &&
         state.body_velocities.size() == state.body_poses.size();
}

}  // namespace

NewtonSolver::NewtonSolver(std::vector<Energy*> terms, DofLayout layout, const SolverOptions& options)
    : options_(checked(options)),
      layout_(layout),
      clock_(options.clock ? options.clock : steady_seconds),
      potential_(std::move(terms), layout, options),
      factor_(options, potential_.hessian()),
      prices_(step_work({potential_.potential_blocks(), factor_.operations(), factor_.entries()})),
      policy_(options, prices_),
      line_search_(layout),
      predictor_(options, layout),
      linkage_(layout),
      loose_solve_(layout.dof_count()),
      local_newton_(layout),
      elimination_(layout, potential_.hessian()),
      condensed_newton_(layout),
      room_(options.condenses_all_contact ? CondensedNewton::kMaxBlocks : CondensedNewton::room(prices_.per_operation)),
      compliance_(potential_.hessian().core_count(), room_),
      best_(empty_state(layout)) {
  pull_ = direction_ = relief_ = VectorX::Zero(layout.dof_count());
}

StepReport NewtonSolver::step(State& state, double time_step) {
  StepMeter meter(prices_, clock_);
  StepReport& report = meter.report;
  if (!(time_step >= 0) || !std::isfinite(time_step) || !fits(state, layout_) || !all_finite(state)) return report;
  if (time_step == 0) {
    report.status = StepStatus::converged;
    return report;
  }
  {
    const auto timer = meter.time(&StepTiming::begin);
    potential_.begin_step(state, time_step);
  }
  bool may_be_chord = prepare_ && prepare_(linkage_) && options_.chord_tolerance > 0;
  const bool has_guess = make_guess(state, time_step);
  may_be_chord = may_be_chord && !linkage_.any_touching();
  bool is_finite = true;
  auto predicted = Predictor::Outcome::failed;
  if (may_be_chord && predictor_.is_promising()) {
    policy_.drop_factor();
    predicted = predictor_.step(state, time_step, potential_, factor_, linkage_, meter);
    if (predicted == Predictor::Outcome::converged && revise(state)) predicted = Predictor::Outcome::failed;
    may_be_chord = !linkage_.any_touching();
  }
  if (predicted == Predictor::Outcome::converged) {
    report.status = StepStatus::converged;
    report.measured = true;
  } else {
    // In the fast mode the iterations begin at the step's start, as in the source.
    const bool continues = predicted == Predictor::Outcome::lowered && options_.max_iterations >= kFewIterations;
    if (!continues) {
      state = potential_.start();
      meter.restore({});
    }
    is_finite = minimise(state, time_step, may_be_chord, has_guess && !continues, continues, meter);
    if (is_finite && report.status == StepStatus::failed_factorisation && report.iterations == 0) {
      state = potential_.start();
      report.measured = false;
      forget();
      return report;
    }
  }
  if (is_finite) {
    if (prepare_) predictor_.end_step(potential_.start(), state, time_step, linkage_);
    const auto timer = meter.time(&StepTiming::end);
    potential_.end_step(state);
    is_finite = all_finite(state);
  }
  if (!is_finite) {
    state = potential_.start();
    report.status = StepStatus::nonfinite;
    report.measured = false;
    forget();
    return report;
  }
  if (predicted == Predictor::Outcome::converged) {
    report.chord = true;
    policy_.set_carried({});
  } else {
    const double fastest = layout_.node_count > 0 ? state.node_velocities.colwise().norm().maxCoeff() : 0.0;
    policy_.end_step(time_step, fastest, report);
    if (may_be_chord && !linkage_.any_touching() && report.factorisations > report.kink_factors &&
        !factor_.is_fallback() && report.shifts == 0)
      predictor_.keep_factor(time_step);
  }
  report.state_changed = true;
  return report;
}

// Makes `best_` the guess of the end of the step. Returns whether there is one. In the air only a step with a budget
// has a guess, because it has hardly time to find its contacts. The contacts of the guess are added: iterations that
// begin there must not leave a thin wall on its other side. Where velocities predict the guess, they have predicted its
// contacts.
bool NewtonSolver::make_guess(const State& state, double time_step) {
  if (!guess_ || options_.max_iterations < kFewIterations) return false;
  if (!linkage_.any_touching() && options_.work_budget == 0) return false;
  best_ = state;
  if (!guess_(linkage_, time_step, best_)) return false;
  if (linkage_.prediction_error(state, best_, time_step) > kWellPredicted) revise(best_);
  return true;
}

// Evaluates the state where the iterations begin: `state`, or the guess if that is better. `continues`: as in
// `minimise`. Returns false if a value is NaN or infinite.
bool NewtonSolver::evaluate_first(State& state, bool has_guess, bool continues, bool hessian, StepMeter& meter) {
  StepReport& report = meter.report;
  if (!potential_.evaluate(state, meter, {.hessian = hessian && !has_guess, .may_be_result = false})) return false;
  if (!continues) {
    for (std::size_t t = 0; t < report.term_count; ++t) report.terms[t].start = report.terms[t].joules;
  }
  if (!has_guess) return true;
  const double energy = report.energy, residual = report.residual;
  state = best_;
  if (potential_.evaluate(state, meter, {.hessian = hessian, .may_be_result = false}) && report.energy < energy &&
      report.residual < residual)
    return true;
  state = potential_.start();
  return potential_.evaluate(state, meter, {.hessian = hessian, .may_be_result = false});
}

// Newton's iterations from `state`, to the end of an ordinary step. `has_guess`: `best_` is a guess of its end.
// `continues`: a chord step did not converge, but `state` has less energy than the start of the step. Returns false if
// a value is NaN or infinite.
bool NewtonSolver::minimise(State& state, double time_step, bool may_be_chord, bool has_guess, bool continues,
                            StepMeter& meter) {
  StepReport& report = meter.report;
  const bool is_truncated = options_.work_budget > 0 || options_.max_iterations < kFewIterations;
  bool touches = linkage_.any_touching();
  predictor_.begin_ordinary_step();
  condensed_newton_.forget_factor();
  if (!touches) policy_.set_touches_much(false);
  bool condenses = touches && !policy_.carried().touches_much && factor_.has_halves();
  const bool is_usable = condenses == factor_.is_without_kinks();
  if (!is_usable) policy_.drop_factor();
  policy_.begin_step(time_step, continues && report.factorisations > 0 && is_usable, touches);
  condenses = condenses && policy_.may_condense();
  bool evaluated = true;                // the report's energy and residual are those of `state`
  bool has_gradient = true;             // if `evaluated`: and so is the potential's gradient
  bool linearised = !policy_.reuses();  // and so is the Hessian
  int revisions = 0;
  double moved = 0;  // since the terms last changed
  bool have_best = false;
  double best_energy = 0;
  report.status = StepStatus::iteration_limit;
  if (!evaluate_first(state, has_guess, continues, linearised, meter)) return false;
  for (std::int64_t iteration = 0; iteration < options_.max_iterations; ++iteration) {
    if (policy_.has_converged(report)) {
      report.status = StepStatus::converged;
      break;
    }
    if (iteration > 0 && (!have_best || report.energy < best_energy)) {
      best_ = state;
      best_energy = report.energy;
      have_best = true;
    }
    auto decision =
        policy_.decide(report, !condenses && factor_.is_of(potential_) && !potential_.kinked().empty(), condenses);
    if (decision.stops) {
      report.status = StepStatus::budget_spent;
      break;
    }
    const bool is_last = iteration + 1 == options_.max_iterations;
    evaluated = !is_last || options_.measure_result || have_best;
    const double residual_before = report.residual;
    double scale = 0;
    bool factorised = true, has_direction = true;
    // Usually one pass. If the energy does not fall along the direction, the next pass has a better factor.
    do {
      if (decision.renewal == FactorPolicy::Renewal::kinks && !factor_.renew_kinks(potential_, state, meter))
        decision.renewal = FactorPolicy::Renewal::whole;
      if (decision.renewal == FactorPolicy::Renewal::whole) {
        if (!linearised) potential_.evaluate(state, meter, {.hessian = true});
        factorised = factor_.renew(potential_, state, decision.in_double, condenses, meter);
        if (!factorised) break;
        compliance_.clear();
        condensed_newton_.forget_factor();
        if (may_be_chord) linkage_.set_earlier_state(state);
      }
      has_direction = find_direction(state, condenses, meter);
      if (!has_direction) {
        // The condensed model has no solution or no room for the contacts. It has no solution if the exact Hessian is
        // indefinite without the contacts that the factor has in addition. Then a projected Hessian is tried.
        // Otherwise the rest of the step takes plain factors.
        decision.renewal = FactorPolicy::Renewal::whole;
        linearised = !policy_.carried().touches_much && potential_.project_hessian(state, meter);
        condenses = linearised;
        continue;
      }
      if (!direction_.allFinite()) return false;
      report.increment = direction_.size() > 0 ? direction_.lpNorm<Eigen::Infinity>() : 0.0;
      linearised = !is_last && !policy_.may_reuse() &&
                   (!policy_.saves_hessians() || policy_.affords_whole_factor(report)) &&
                   kUsualReduction * report.residual > options_.residual_tolerance;
      if (!options_.line_search) {
        linkage_.move(state, direction_, scale = 1);
        if (evaluated && !potential_.evaluate(state, meter, {.hessian = linearised})) return false;
        break;
      }
      scale = line_search_.search(potential_, linkage_, direction_, state, meter,
                                  {.gradient = evaluated, .hessian = linearised});
      // If something else holds the tissue, it does not turn with its bone, and the way along the linkage is short.
      if (scale < kShortStep) linkage_.straighten();
      linearised = linearised && scale == 1;
    } while (!has_direction || (scale == 0 && policy_.improve(decision, factor_.is_most_precise(), report)));
    if (!factorised) {
      report.status = StepStatus::failed_factorisation;
      break;
    }
    if (scale == 0) {
      // No factor gives a direction in which the energy falls: `state` is a minimum in floating point. It can be a kink
      // where the gradient is not zero. If it is not one, the step has converged. The gradient is now that of a trial.
      if (iteration > 0 && !policy_.affords_whole_factor(report)) report.status = StepStatus::budget_spent;
      if (options_.max_iterations > 1 && residual_before <= options_.residual_tolerance)
        report.status = StepStatus::converged;
      report.increment = 0;
      evaluated = true;
      has_gradient = false;
      break;
    }
    // A step that is cut off has more important work: with and without this, recorded fists were equally far off.
    if (!is_truncated && evaluated) {
      const Moved relieved = relieve_nodes(state, condenses, meter);
      if (relieved == Moved::not_finite) return false;
      linearised = linearised && relieved == Moved::no;
    }
    policy_.learn(decision,
                  {.scale = scale,
                   .condenses = condenses,
                   .move = scale * largest_move(state, condenses),
                   .residual_before = residual_before,
                   .measured = evaluated},
                  report);
    ++report.iterations;
    // A step that converges soon is revised twice. Once contact is solved roughly, it is revised for the first time,
    // so that the next iterations serve the new terms too. At its end it is revised again, so that its result hardly
    // depends on the way there. In between it is revised if something has moved far.
    if (iteration > 0) moved += scale * report.increment;
    const bool is_rough = revisions == 0 && report.residual <= kRough;
    const bool may_be_last = is_truncated || (condenses && (is_rough || moved > kFarMove)) ||
                             iteration >= kLateIteration || policy_.has_converged(report) ||
                             report.increment <= options_.increment_tolerance;
    if (may_be_last && revisions < kMaxRevisions && revise(state)) {
      ++revisions;
      moved = 0;
      touches = linkage_.any_touching();
      may_be_chord = may_be_chord && !touches;
      policy_.start_again(condenses);
      if (!potential_.evaluate(state, meter, {})) return false;
      if (!is_truncated && scale * report.increment > kFarMove && !retreat(state, meter)) return false;
      evaluated = true;
      linearised = have_best = false;
      continue;
    }
    if (report.increment <= options_.increment_tolerance) {
      report.status = StepStatus::converged;
      break;
    }
  }
  if (evaluated && report.status == StepStatus::iteration_limit && policy_.has_converged(report))
    report.status = StepStatus::converged;
  if (have_best && best_energy + report.rounding() < report.energy) {
    // A line search only descends, so this happens only without line search.
    state = best_;
    potential_.evaluate(state, meter, {});
  }
  const bool is_cut_off = report.status == StepStatus::budget_spent ||
                          (report.status == StepStatus::iteration_limit && options_.max_iterations < kFewIterations);
  if (is_cut_off && touches && report.factorisations > report.kink_factors && report.shifts == 0) {
    if (!(evaluated && has_gradient) && !potential_.evaluate(state, meter, {})) return false;
    evaluated = true;
    // A condensed step that is near its minimum has solved contact.
    if (!(condenses && FactorPolicy::is_balanced(report))) {
      if (policy_.saves_hessians() && !linearised && !potential_.evaluate(state, meter, {.hessian = true}))
        return false;
      if (!solve_contact(state, meter)) return false;
    }
  }
  report.measured = evaluated;
  return true;
}

// After a revision. An iteration can move a light body far into another one before their contacts are found. The way
// out of it can crush the body. So if the start of the step, with the new contacts, has much less energy, the
// iterations begin there again. Returns false if a value is NaN or infinite.
bool NewtonSolver::retreat(State& state, StepMeter& meter) {
  StepReport& report = meter.report;
  const double energy = report.energy;
  double start = 0;  // without the new contacts; 0 after a chord step
  for (std::size_t t = 0; t < report.term_count; ++t) start += report.terms[t].start;
  if (energy <= 0 || start >= kMuchLess * energy) return true;
  best_ = state;
  state = potential_.start();
  if (!potential_.evaluate(state, meter, {})) return false;
  if (report.energy < kMuchLess * energy) return true;
  state = best_;
  return potential_.evaluate(state, meter, {});
}

// Newton's direction at `state`. `condenses`: the terms with kinks are exact, and the factor is that of the other
// terms. Returns false if this fails. Without `condenses` it does not fail.
bool NewtonSolver::find_direction(const State& state, bool condenses, StepMeter& meter) {
  const auto timer = meter.time(&StepTiming::solve);
  if (!condenses) {
    // A step that is cut off may touch with more than its minimum does.
    if (options_.work_budget > 0 && policy_.carried().touches_much &&
        condensed_newton_.touched_blocks(potential_.hessian()) <= kRoomy * room_)
      policy_.set_touches_much(false);
    pull_ = -potential_.gradient();
    loose_solve_.solve(factor_, potential_.hessian(), pull_, direction_, policy_.work_for_solves(meter.report), meter);
    return true;
  }
  if (!factor_.is_without_kinks()) return false;
  const CondensedNewton::Result result =
      condensed_newton_.minimise(state, potential_.kinked(), potential_.curvature(), potential_.gradient(),
                                 kContactTolerance * options_.residual_tolerance, potential_.change_hessian(),
                                 factor_.linear_solver(), factor_.kept_kinks(), compliance_, direction_);
  if (result == CondensedNewton::Result::no_room) policy_.set_touches_much(true);
  meter.report.work += meter.prices.solve + meter.prices.per_operation *
                                                (compliance_.take_operations() + condensed_newton_.take_operations());
  return result == CondensedNewton::Result::found;
}

// Lets the terms change after an iteration. Returns whether the energy has changed.
bool NewtonSolver::revise(const State& state) {
  const bool changed = potential_.revise(state);
  if (changed && prepare_) prepare_(linkage_);
  return changed;
}

// Moves the touched nodes and objects towards their equilibrium, or only the rigid objects. The rest of the hand gives
// way along a few modes. Energy, residual and gradient must be those of `state`. If nothing moves, the gradient may be
// that of a trial.
NewtonSolver::Moved NewtonSolver::move_touched(State& state, bool objects_only, StepMeter& meter) {
  const StepWork& prices = meter.prices;
  LocalNewton::Result result;
  {
    const auto timer = meter.time(&StepTiming::solve);
    const double remaining = options_.work_budget - meter.report.work - prices.contact_blocks - prices.evaluation;
    const int most_modes =
        remaining > 0 && !objects_only ? static_cast<int>(std::min(remaining / prices.solve, 100.0)) : 0;
    const double most_operations = std::max(remaining, kContactWork) / prices.per_local_operation;
    result = local_newton_.minimise(state, potential_.kinked(), potential_.curvature(), potential_.gradient(),
                                    potential_.change_hessian(), objects_only, most_modes, most_operations,
                                    factor_.linear_solver(), direction_);
  }
  meter.report.work +=
      prices.contact_blocks + prices.per_local_operation * result.operations + result.modes * prices.solve;
  if (!result.found) return Moved::no;
  ++meter.report.contact_solves;
  if (line_search_.search(potential_, linkage_, direction_, state, meter, {}) == 0) return Moved::no;
  if (revise(state) && !potential_.evaluate(state, meter, {})) return Moved::not_finite;
  return Moved::yes;
}

// Brings a few nodes with large residual forces into balance with what is around them. Energy, residual and gradient
// must be those of `state`.
NewtonSolver::Moved NewtonSolver::relieve_nodes(State& state, bool condenses, StepMeter& meter) {
  const bool knows_kinks = condenses || potential_.hessian().journal().empty();
  if (!knows_kinks || !potential_.knows_other_stiffness()) return Moved::no;
  StepReport& report = meter.report;
  const StepWork& prices = meter.prices;
  const auto nodes = potential_.gradient().head(3 * layout_.node_count);
  const double largest = nodes.size() > 0 ? nodes.lpNorm<Eigen::Infinity>() : 0.0;
  if (largest <= std::max(kLeastRelief, kDominant * report.residual)) return Moved::no;
  NonlinearElimination::Result result;
  {
    const auto timer = meter.time(&StepTiming::solve);
    if (condenses)
      MovingBlocks::renew_kinked(potential_.kinked(), state, potential_.curvature(), potential_.change_hessian());
    result = elimination_.minimise(state, potential_, condenses, relief_);
    if (condenses) potential_.change_hessian().take_back();
  }
  report.work += (condenses ? prices.contact_blocks : 0.0) + result.share * prices.linearisation +
                 result.operations * prices.per_operation;
  if (!result.found) return Moved::no;
  const double increment = report.increment;
  const double scale = line_search_.search(potential_, linkage_, relief_, state, meter, {.gradient = true});
  report.increment = increment;
  // The gradient is that of a trial if no trial lowers the energy.
  if (scale == 0 && !potential_.evaluate(state, meter, {})) return Moved::not_finite;
  return scale == 0 ? Moved::no : Moved::yes;
}

// Solves contact after a step that did not converge. Returns false if a value is NaN or infinite.
bool NewtonSolver::solve_contact(State& state, StepMeter& meter) {
  Moved moved = Moved::yes;
  for (int k = 0; k < kContactSolves && moved == Moved::yes; ++k) {
    if (k > 0 && policy_.exceeds_overrun(meter.report)) break;
    moved = move_touched(state, false, meter);
  }
  // Far from the minimum the quadratic model of the tissue is wrong, and the line search stops objects with the tissue.
  // But an object that stays in the skin is pressed with many times the force. Objects alone need no model of tissue.
  if (moved == Moved::not_finite || layout_.border_bodies == 0 || FactorPolicy::is_balanced(meter.report))
    return moved != Moved::not_finite;
  if (moved == Moved::no && !potential_.evaluate(state, meter, {})) return false;
  return move_touched(state, true, meter) != Moved::not_finite;
}

// Returns the largest movement of a node or body in the last iteration's increment, relative to its tolerance. A
// rotation counts as a length, with the lever sqrt(tr H_rr / tr H_tt). For a free body this is its radius of gyration.
// The tolerance of a body is proportional to its movement in the step, whatever its mass. Reason: residuals do not show
// the error of light bodies.
double NewtonSolver::largest_move(const State& state, bool condenses) const {
  const double most = std::max(options_.movement_tolerance, std::numeric_limits<double>::min());
  double largest =
      layout_.node_count > 0 ? direction_.head(3 * layout_.node_count).lpNorm<Eigen::Infinity>() / most : 0.0;
  const auto trace = [this](int block) {
    return potential_.diagonal(block, 0) + potential_.diagonal(block, 1) + potential_.diagonal(block, 2);
  };
  for (int body = 0; body < layout_.body_count; ++body) {
    const int translation = layout_.body_translation_block(body), rotation = layout_.body_rotation_block(body);
    const Pose &now = state.body_poses[static_cast<std::size_t>(body)],
               &start = potential_.start().body_poses[static_cast<std::size_t>(body)];
    const double stiffness = trace(translation);
    const double lever = stiffness > 0 ? std::sqrt(std::max(0.0, trace(rotation)) / stiffness) : 0.0;
    const double turn = 2 * (now.orientation.coeffs() - start.orientation.coeffs()).norm();
    const double moved = std::max((now.position - start.position).lpNorm<Eigen::Infinity>(), lever * turn);
    const bool is_held =
        condenses && (translation < potential_.hessian().core_count() || condensed_newton_.moves(translation));
    const double full = is_held ? kFullMoveHeld : kFullMove;
    const double tolerance = most * std::clamp(moved, kLeastMove, full) / full;
    const double move = std::max(direction_.segment<3>(3 * translation).lpNorm<Eigen::Infinity>(),
                                 lever * direction_.segment<3>(3 * rotation).lpNorm<Eigen::Infinity>());
    largest = std::max(largest, move / tolerance);
  }
  return largest;
}

void NewtonSolver::use_linkage(Linkage linkage, std::function<bool(Linkage&)> prepare, Guess guess) {
  linkage_ = std::move(linkage);
  prepare_ = std::move(prepare);
  guess_ = std::move(guess);
}

void NewtonSolver::forget() {
  potential_.forget();
  factor_.forget();
  compliance_.clear();
  policy_.set_carried({});
  predictor_.forget();
}

void NewtonSolver::take_factor(const NewtonSolver& other) {
  if (!factor_.take_over(other.factor_)) return;
  potential_.take_over(other.potential_, factor_.is_of(other.potential_) || factor_.is_without_kinks());
  compliance_ = other.compliance_;
  policy_.set_carried(other.policy_.carried());
  predictor_.set_carried(other.predictor_.carried());
  linkage_ = other.linkage_;
}

}  // namespace softhand
