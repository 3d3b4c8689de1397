#include "solver/newton_solver.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "math/rotation.hpp"
#include "solver/block_cholesky.hpp"

namespace softhand {
namespace {

constexpr int kMaxShifts = 8;
constexpr double kFirstShift = 1e-4;  // fraction of the diagonal entry; each retry has ten times more
constexpr int kMaxHalvings = 30;
constexpr double kArmijo = 1e-4;
constexpr int kMaxChordIterations = 6;
// Ratio of two increments. Above it, a new factor costs less than the iterations that it saves.
constexpr double kSlowContraction = 0.15;
constexpr double kStalled = 0.5;     // ratio of two increments of a chord step, or of two residuals
constexpr double kNoEnergy = 1e-12;  // J, 1 mN over 1 nm: smaller energy differences are rounding errors
// With fewer iterations than this, a step cannot measure how well a reused factor contracts.
constexpr std::int64_t kFewIterations = 3;
// This many iterations with a reused factor cost as much as one iteration with a new Hessian and factor.
constexpr double kEquivalentIterationsProjected = 8;
constexpr double kEquivalentIterationsExact = 4;  // the same if the new Hessian is exact: then it converges faster
// m. If a body moves less than kFullMove in the step, its tolerance shrinks in proportion. The tolerance stops
// shrinking at a movement of kLeastMove.
constexpr double kFullMove = 0.05;
constexpr double kLeastMove = 1e-5;
constexpr double kKinkFraction = 0.6;  // expected cost of renewing contact and friction, in whole factors
// Relative change of the blocks of contact and friction. If they change less, the rest of the Hessian is what is stale.
constexpr double kKinkChange = 0.05;
constexpr int kMaxConsecutiveKinkFactors = 2;  // after this many, the rest of the Hessian may be stale
constexpr double kSlowest = 0.9;  // cap on the ratio of two increments when the remaining movement is estimated
// Usual ratio of the residuals after and before an iteration. It only decides whether the Hessian is computed together
// with the next gradient.
constexpr double kUsualReduction = 0.01;
constexpr int kMaxBracketings = 6;
// Limits of the slope at the end of a line search, as fractions of the slope at its start.
constexpr double kLevel = 0.5;   // beyond the minimum
constexpr double kShort = 0.05;  // before the minimum, unless it is a full step
constexpr double kFar = 0.6;  // before the minimum, after a full step: above it the Hessian is too stiff along the step
// Growth of the scale if the search goes on beyond a full step.
constexpr double kLeastStride = 1.5, kLongestStride = 4;
constexpr double kInside = 0.05;       // fraction of a bracket: least distance of the next trial from the ends
constexpr double kPredictable = 2e-3;  // m, RMS of the bones: if the prediction error is larger, chord steps fail
constexpr double kShortStep = 0.2;     // scale of an iteration: if it is shorter, all further moves are straight
constexpr int kMaxRevisions = 4;       // of the terms in a step
constexpr int kContactSolves = 3;      // after a step that did not converge
constexpr double kNoise = 100;         // times the rounding of the energy: no search if the slope promises less

double steady_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

State empty_state(DofLayout layout) {
  State state;
  state.node_positions = state.node_velocities = Eigen::Matrix3Xd::Zero(3, layout.node_count);
  state.body_poses.resize(static_cast<std::size_t>(layout.body_count));
  state.body_velocities.resize(static_cast<std::size_t>(layout.body_count));
  return state;
}

// Bound of the rounding error of the sum of the terms, J.
double rounding_of_energy(const StepReport& report) {
  double sum = 0;
  for (std::size_t t = 0; t < report.term_count; ++t) sum += std::abs(report.terms[t].joules);
  return 1e-14 * sum;
}

// The number of iterations until `now` falls to `tolerance` at this contraction.
double iterations_until(double now, double tolerance, double contraction) {
  if (now <= tolerance) return 0;
  return contraction < 1 ? std::log(tolerance / now) / std::log(contraction) : std::numeric_limits<double>::infinity();
}

bool fits(const State& state, DofLayout layout) {
  return state.node_positions.cols() == layout.node_count && state.node_velocities.cols() == layout.node_count &&
         state.body_poses.size() == static_cast<std::size_t>(layout.body_count) &&
         state.body_velocities.size() == state.body_poses.size();
}

}  // namespace

std::string_view to_string(StepStatus status) {
  constexpr std::array<std::string_view, 6> names{
      "converged", "iteration_limit", "budget_spent", "failed_factorisation", "nonfinite", "refused"};
  return names[static_cast<std::size_t>(status)];
}

NewtonSolver::NewtonSolver(std::vector<Energy*> terms, DofLayout layout, const SolverOptions& options)
    : terms_(std::move(terms)),
      layout_(layout),
      options_(options),
      curvature_(options.curvature == "exact" ? Curvature::exact : Curvature::projected),
      // If the exact Hessian is not positive definite, the work of its factor is lost. A work budget cannot afford
      // this.
      tries_exact_(options.curvature == "adaptive" && options.max_iterations >= kFewIterations &&
                   options.work_budget == 0),
      tries_exact_now_(tries_exact_),
      local_newton_(layout),
      clock_(options.clock ? options.clock : steady_seconds) {
  if (terms_.size() > kMaxTerms)
    throw std::invalid_argument("NewtonSolver: at most " + std::to_string(kMaxTerms) + " terms");
  if (options_.max_iterations < 1) throw std::invalid_argument("NewtonSolver: max_iterations must be at least 1");
  if (options_.curvature != "exact" && options_.curvature != "projected" && options_.curvature != "adaptive") {
    throw std::invalid_argument("NewtonSolver: curvature must be adaptive, projected or exact, got " +
                                options_.curvature);
  }
  if (options_.factor != "float" && options_.factor != "double") {
    throw std::invalid_argument("NewtonSolver: factor must be float or double, got " + options_.factor);
  }
  if (options_.linear_solver) {
    linear_solver_ = options_.linear_solver();
  } else if (options_.factor == "float") {
    linear_solver_ = std::make_unique<BlockCholesky<float>>(widest_instruction_set(), options_.helper);
    precise_solver_ = std::make_unique<BlockCholesky<double>>(widest_instruction_set(), options_.helper);
  } else {
    linear_solver_ = std::make_unique<BlockCholesky<double>>(widest_instruction_set(), options_.helper);
  }
  BlockPattern pattern(layout_.block_count());
  for (const Energy* term : terms_) term->add_pattern(pattern);
  hessian_ = BlockMatrix(pattern);
  for (Energy* term : terms_) term->bind(hessian_);
  for (int block = 0; block < layout_.block_count(); ++block) diagonal_.push_back(hessian_.find(block, block).index);
  linear_solver_->analyze(hessian_);
  if (precise_solver_) precise_solver_->analyze(hessian_);
  factor_ = linear_solver_.get();
  double potential_blocks = 0;
  for (std::size_t t = 0; t < terms_.size(); ++t) {
    if (!terms_[t]->is_potential()) continue;
    BlockPattern touched(layout_.block_count());
    terms_[t]->add_pattern(touched);
    std::size_t bodies = 0;
    for (const auto& [column, row] : touched.lower_triangle()) {
      ++potential_blocks;
      if (column != row && row >= layout_.node_count)
        bodies = std::max(bodies, static_cast<std::size_t>(row - layout_.node_count) / 2 + 1);
    }
    potentials_.bodies = std::max(potentials_.bodies, bodies);
    order_.insert(bodies == 0 ? order_.begin() + static_cast<std::ptrdiff_t>(first_bodily_++) : order_.end(), t);
  }
  first_frozen_ = order_.size();
  for (const bool kinked : {false, true}) {
    for (std::size_t t = 0; t < terms_.size(); ++t) {
      if (!terms_[t]->is_potential() && terms_[t]->has_kinks() == kinked) order_.push_back(t);
    }
    if (!kinked) first_kinked_ = order_.size();
  }
  for (std::size_t k = first_kinked_; k < order_.size(); ++k) kinked_.push_back(terms_[order_[k]]);
  work_ = step_work({potential_blocks, linear_solver_->factor_operations(), linear_solver_->factor_entries()});
  changed_.reserve(2 * static_cast<std::size_t>(hessian_.stored_blocks()));
  potentials_.gradient = potentials_.of_nodes = node_gradient_ = previous_node_gradient_ = extrapolated_ =
      VectorX::Zero(layout_.dof_count());
  potentials_.positions = Eigen::Matrix3Xd::Zero(3, layout_.node_count);
  potentials_.poses.resize(static_cast<std::size_t>(layout_.body_count));
  gradient_ = direction_ = tangent_ = displacement_ = VectorX::Zero(layout_.dof_count());
  start_ = base_ = best_ = empty_state(layout_);
}

void NewtonSolver::measure_displacement(const State& state) {
  Eigen::Map<Eigen::Matrix3Xd>(displacement_.data(), 3, layout_.node_count) =
      state.node_positions - start_.node_positions;
  for (int body = 0; body < layout_.body_count; ++body) {
    const Pose& now = state.body_poses[static_cast<std::size_t>(body)];
    const Pose& start = start_.body_poses[static_cast<std::size_t>(body)];
    displacement_.segment<3>(3 * layout_.body_translation_block(body)) = now.position - start.position;
    displacement_.segment<3>(3 * layout_.body_rotation_block(body)) =
        rotation_log(now.orientation * start.orientation.conjugate());
  }
}

bool NewtonSolver::has_potentials_of(const State& state) const {
  if (!potentials_.known || potentials_.positions != state.node_positions) return false;
  for (std::size_t b = 0; b < potentials_.bodies; ++b) {
    const Pose &then = potentials_.poses[b], &now = state.body_poses[b];
    if (then.position != now.position || then.orientation.coeffs() != now.orientation.coeffs()) return false;
  }
  return true;
}

// Evaluates the energy of each term, the gradient and, if `with_hessian`, the Hessian at `state`. Returns false if a
// value is NaN or infinite. `may_be_result`: `state` may be the result of the step, so the work of the step so far is
// measured if `measure_work` requests this. `extrapolated`: an extrapolated gradient of the potentials that depend on
// nodes only. These potentials are then not evaluated, and their energy is the last known one.
bool NewtonSolver::evaluate(const State& state, StepReport& report, bool with_hessian, bool may_be_result,
                            const VectorX* extrapolated) {
  double time = clock_();
  gradient_.setZero();
  if (with_hessian) {
    has_smooth_ = false;
    hessian_is_exact_ = tries_exact_now_;
    hessian_.set_zero();
    const double cleared = clock_();
    report.timing.assembly += cleared - time;
    time = cleared;
  }
  report.energy = 0;
  report.term_count = terms_.size();
  const bool with_work = measures_work_ && may_be_result;
  if (with_work) measure_displacement(state);
  double taken = 0;
  std::size_t known = 0;  // this many terms, in order, are not evaluated
  const Curvature smooth = with_hessian && tries_exact_now_ ? Curvature::exact : curvature_;
  if (extrapolated != nullptr) {
    known = first_bodily_;
    gradient_ = *extrapolated;
  } else if (!with_hessian && !with_work && has_potentials_of(state)) {
    known = first_frozen_;
    gradient_ = potentials_.gradient;
  }
  for (std::size_t k = 0; k < order_.size(); ++k) {
    const std::size_t t = order_[k];
    if (k == first_bodily_ && known == 0) potentials_.of_nodes = gradient_;
    if (k == first_frozen_ && known == 0) {
      potentials_.gradient = gradient_;
      potentials_.positions = state.node_positions;
      potentials_.poses = state.body_poses;
      potentials_.known = true;
    }
    if (with_hessian && k == first_kinked_) hessian_.begin_journal();
    const double energy = k < known ? potentials_.joules[k]
                          : with_hessian
                              ? terms_[t]->add_all(state, gradient_, hessian_, k < first_kinked_ ? smooth : curvature_)
                              : terms_[t]->add_gradient(state, gradient_);
    if (known == 0) potentials_.joules[k] = energy;
    const double taken_so_far = with_work ? gradient_.dot(displacement_) : 0.0;
    report.terms[t].name = terms_[t]->name();
    report.terms[t].joules = energy;
    report.terms[t].taken = taken_so_far - taken;
    taken = taken_so_far;
    report.energy += energy;
  }
  report.residual = layout_.dof_count() > 0 ? gradient_.lpNorm<Eigen::Infinity>() : 0.0;
  report.timing.energies += clock_() - time;
  report.work += with_hessian ? work_.linearisation : known > 0 ? work_.frozen_evaluation : work_.evaluation;
  return std::isfinite(report.energy) && gradient_.allFinite();
}

double NewtonSolver::energy_at(const State& state, StepReport& report) const {
  const double time = clock_();
  double energy = 0;
  for (const Energy* term : terms_) energy += term->value(state);
  report.timing.energies += clock_() - time;
  report.work += work_.evaluation;
  return energy;
}

bool NewtonSolver::factorize(const State& state, StepReport& report, bool in_double) {
  ++report.factorisations;
  has_smooth_ = false;
  double shift = 0;
  factor_ = in_double && precise_solver_ ? precise_solver_.get() : linear_solver_.get();
  for (int attempt = 0; attempt <= kMaxShifts;) {
    double time = clock_();
    factor_->load(hessian_);
    double now = clock_();
    report.timing.assembly += now - time;
    time = now;
    const bool positive = factor_->factorize();
    now = clock_();
    report.timing.factorisation += now - time;
    count_factor(report);
    if (positive) {
      if (factor_ == precise_solver_.get()) ++report.double_factors;
      has_smooth_ = shift == 0;
      return true;
    }
    if (hessian_is_exact_) {
      // The next exact Hessians of the step are not likely to be positive definite either.
      tries_exact_now_ = false;
      evaluate(state, report, true);
      continue;
    }
    if (precise_solver_ && factor_ != precise_solver_.get()) {
      // The matrix may still be positive definite in double.
      factor_ = precise_solver_.get();
      continue;
    }
    // The shift of each entry is relative to the entry: entries per metre and per radian differ by orders of magnitude.
    const double next = attempt++ == 0 ? kFirstShift : 10.0 * shift;
    double largest = 0;
    const auto entry = [this](std::int32_t block, int k) -> double& {
      return hessian_.values()[static_cast<std::size_t>(9 * block + 4 * k)];
    };
    for (const std::int32_t block : diagonal_) {
      for (int k = 0; k < 3; ++k) largest = std::max(largest, std::abs(entry(block, k)));
    }
    for (const std::int32_t block : diagonal_) {
      for (int k = 0; k < 3; ++k)
        entry(block, k) += (next - shift) * std::max(std::abs(entry(block, k)), 1e-9 * largest);
    }
    shift = next;
    ++report.shifts;
    report.timing.assembly += clock_() - now;
  }
  return false;
}

// Renews the part of the terms with kinks in the last factor's matrix, at `state`. The rest of the matrix is unchanged.
// Returns false if that part hardly changed or if the sum is not positive definite. Then the whole Hessian must be
// renewed.
bool NewtonSolver::renew_kinks(const State& state, StepReport& report) {
  double time = clock_();
  changed_.assign(hessian_.journal().begin(), hessian_.journal().end());
  hessian_.take_back();
  for (std::size_t k = first_kinked_; k < order_.size(); ++k)
    terms_[order_[k]]->add_hessian(state, hessian_, curvature_);
  changed_.insert(changed_.end(), hessian_.journal().begin(), hessian_.journal().end());
  report.work += work_.contact_blocks;
  has_smooth_ = hessian_.change_since_taken_back() > kKinkChange;
  double now = clock_();
  report.timing.energies += now - time;
  time = now;
  if (!has_smooth_) return false;
  ++report.factorisations;
  ++report.kink_factors;
  factor_->load(hessian_);
  has_smooth_ = factor_->refactorize(changed_);
  count_factor(report);
  report.timing.factorisation += clock_() - time;
  return has_smooth_;
}

void NewtonSolver::count_factor(StepReport& report) const {
  report.work +=
      work_.per_operation * factor_->last_operations() * (factor_ == precise_solver_.get() ? work_.per_double : 1.0);
}

// Moves `state` by `scale` times the direction, along the linkage if there is one.
void NewtonSolver::move(State& state, double scale) {
  if (prepare_) {
    linkage_.move(state, direction_, scale, tangent_);
  } else {
    apply_increment(state, direction_, scale);
    tangent_ = direction_;
  }
}

// Moves the touched nodes and objects towards their equilibrium while everything else stays. Energy, residual and
// gradient must be those of `state`. False if nothing was found or the energy does not fall.
bool NewtonSolver::solve_contact(State& state, StepReport& report) {
  const double begin = clock_();
  const double remaining = options_.work_budget - report.work - work_.contact_blocks - work_.evaluation;
  const int most_modes = remaining > 0 ? static_cast<int>(std::min(remaining / work_.solve, 100.0)) : 0;
  const LocalNewton::Result result =
      local_newton_.minimise(state, kinked_, curvature_, gradient_, hessian_, most_modes, *factor_, direction_);
  report.timing.solve += clock_() - begin;
  report.work += work_.contact_blocks + work_.per_local_operation * result.operations + result.modes * work_.solve;
  has_smooth_ = false;  // `hessian_` no longer belongs to the last factor
  if (!result.found) return false;
  ++report.contact_solves;
  return search(state, report, true, false) > 0;
}

// Line search. Finds a state along the direction where E has fallen by Armijo's rule and is near its minimum. Returns
// the scale of the step. Returns 0 if E does not fall in floating point. Then `state` and `report` are unchanged,
// except for time and work. `measured`: energy and gradient are evaluated at the result. `with_hessian`: the Hessian is
// evaluated too at a full step.
//
// The second derivative of E jumps at kinks: contacts begin and end, friction sticks and slides. The Hessian before a
// kink does not know the far side. Steps that are only halved until E falls would approach the kink in each iteration
// and never cross it. So the search brackets the minimum by the slope and ends at the minimum or beyond, where the next
// Hessian is different.
//
// A full step may also end far before the minimum. A Hessian that was made positive semi-definite is too stiff where
// tissue snaps through, for dozens of iterations. In this case the search continues beyond the full step.
double NewtonSolver::search(State& state, StepReport& report, bool measured, bool with_hessian) {
  const double slope = gradient_.dot(direction_);
  const double rounding = rounding_of_energy(report);
  const StepReport before = report;
  base_ = state;
  // Close to the minimum, the decrease of E is below the rounding error. Then E must only not rise by more than that
  // error.
  const auto bound = [&](double scale) { return before.energy + kArmijo * scale * slope + rounding; };
  double scale = 1;
  if (measured) {
    double low = 0, low_slope = slope;  // scale at which E still falls
    double high = 0, high_slope = 0;    // scale at which E rises again, or did not fall enough
    int side = 0;
    for (int trial = 0; trial <= kMaxBracketings; ++trial) {
      move(state, scale);
      const bool finite = evaluate(state, report, with_hessian && trial == 0);
      const double there = finite ? gradient_.dot(tangent_) : 0.0;
      const bool falls = finite && report.energy <= bound(scale);
      const bool is_bracketed = high > 0;
      const bool continues =
          falls && !is_bracketed && there < kFar * slope && -slope > kNoise * rounding && trial < kMaxBracketings;
      const bool level =
          there <= -kLevel * slope && (there >= kShort * slope || !is_bracketed || trial == kMaxBracketings);
      if (falls && !continues && (level || -slope <= kNoise * rounding)) {
        report.increment *= scale;
        return scale;
      }
      state = base_;
      if (continues) {
        const double root = there > low_slope ? low + low_slope / (low_slope - there) * (scale - low)
                                              : std::numeric_limits<double>::infinity();
        low = scale;
        low_slope = there;
        scale = std::clamp(root, kLeastStride * low, kLongestStride * low);
        continue;
      }
      // Regula falsi with the Illinois rule (Dowell and Jarratt 1971, BIT 11:168): if an end of the bracket stays
      // twice, its slope is halved, so that it moves.
      if (falls && there < 0) {
        low = scale;
        low_slope = there;
        if (side < 0) high_slope *= 0.5;
        side = -1;
      } else {
        high = scale;
        high_slope = there;
        if (side > 0) low_slope *= 0.5;
        side = 1;
      }
      const double root = high_slope > 0 ? low_slope / (low_slope - high_slope) : 0.5;
      scale = low + std::clamp(root, kInside, 1 - kInside) * (high - low);
    }
    scale = low > 0 ? low : 0.5 * high;
  }
  for (int halving = 0; halving <= kMaxHalvings; ++halving, scale *= 0.5) {
    move(state, scale);
    if (energy_at(state, report) <= bound(scale) &&
        (!measured || (evaluate(state, report, false) && report.energy <= bound(scale)))) {
      report.increment *= scale;
      return scale;
    }
    state = base_;
  }
  const StepTiming timing = report.timing;
  const double work = report.work;
  report = before;
  report.timing = timing;
  report.work = work;
  return 0;
}

// Returns the largest movement of a node or body in the last iteration's increment, relative to its tolerance. A
// rotation counts as a length, with the lever sqrt(tr H_rr / tr H_tt). For a free body this is its radius of gyration.
// The tolerance of a body is proportional to its movement in the step, whatever its mass. Reason: residuals do not show
// the error of light bodies.
double NewtonSolver::largest_move(const State& state) const {
  const double most = std::max(options_.movement_tolerance, std::numeric_limits<double>::min());
  double largest =
      layout_.node_count > 0 ? direction_.head(3 * layout_.node_count).lpNorm<Eigen::Infinity>() / most : 0.0;
  const auto trace = [this](int block) {
    const double* const values =
        hessian_.values().data() + 9 * static_cast<std::ptrdiff_t>(diagonal_[static_cast<std::size_t>(block)]);
    return values[0] + values[4] + values[8];
  };
  for (int body = 0; body < layout_.body_count; ++body) {
    const int translation = layout_.body_translation_block(body), rotation = layout_.body_rotation_block(body);
    const Pose &now = state.body_poses[static_cast<std::size_t>(body)],
               &start = start_.body_poses[static_cast<std::size_t>(body)];
    const double stiffness = trace(translation);
    const double lever = stiffness > 0 ? std::sqrt(std::max(0.0, trace(rotation)) / stiffness) : 0.0;
    const double turn = 2 * (now.orientation.coeffs() - start.orientation.coeffs()).norm();
    const double moved = std::max((now.position - start.position).lpNorm<Eigen::Infinity>(), lever * turn);
    const double tolerance = most * std::clamp(moved, kLeastMove, kFullMove) / kFullMove;
    const double move = std::max(direction_.segment<3>(3 * translation).lpNorm<Eigen::Infinity>(),
                                 lever * direction_.segment<3>(3 * rotation).lpNorm<Eigen::Infinity>());
    largest = std::max(largest, move / tolerance);
  }
  return largest;
}

StepReport NewtonSolver::step(State& state, double time_step) {
  StepReport report;
  if (!(time_step >= 0) || !std::isfinite(time_step) || !fits(state, layout_) || !all_finite(state)) return report;
  if (time_step == 0) {
    report.status = StepStatus::converged;
    return report;
  }
  const double begin = clock_();
  start_ = state;
  for (Energy* term : terms_) term->begin_step(state, time_step);
  report.timing.begin = clock_() - begin;

  const auto give_up = [&] {
    state = start_;
    report.status = StepStatus::nonfinite;
    report.state_changed = false;
    return report;
  };
  bool continues_chord_step = false;  // a chord step did not converge, but its state has less energy than the start
  bool may_be_chord = prepare_ && prepare_(linkage_) && options_.chord_tolerance > 0;
  bool touches = prepare_ && linkage_.any_touching();
  if (may_be_chord && is_predictable_) {
    if (chord_step(state, time_step, report)) return report;
    // In the fast mode the iterations begin at the step's start, as in the source.
    continues_chord_step = std::exchange(report.chord, false) && options_.max_iterations >= kFewIterations;
    touches = linkage_.any_touching();
    may_be_chord = !touches;
    if (!continues_chord_step) {
      state = start_;
      const StepTiming spent = report.timing;
      const double work = report.work;
      report = {};
      report.timing = spent;
      report.work = work;
    }
  }
  chord_time_step_ = node_gradient_time_step_ = 0;
  tries_exact_now_ = tries_exact_;
  // Whether a factor may be reused in several iterations, including the factor of the last step. Steps with few
  // iterations use plain Newton iterations.
  const bool may_reuse =
      options_.keep_factor && options_.line_search && options_.max_iterations >= kFewIterations && !was_cut_off_;
  const double equivalent_iterations = tries_exact_ ? kEquivalentIterationsExact : kEquivalentIterationsProjected;
  // Whether the next iteration reuses the last factor.
  bool reuses_factor =
      may_reuse && (reusable_time_step_ == time_step || (continues_chord_step && report.factorisations > 0));
  reusable_time_step_ = 0;
  bool have_best = false;
  bool evaluated = true;             // the report's energy and residual, and `gradient_`, are those of `state`
  bool linearised = !reuses_factor;  // `hessian_` is that of `state`
  bool in_double = false;            // the next factors are in double
  bool needs_double = false;         // a float factor made no progress
  bool double_helps = true;  // double converges better than float if float converges slowly; true until disproved
  // Number of consecutive iterations so far whose factor was renewed only in the terms with kinks.
  int consecutive_kink_factors = reuses_factor ? 0 : kMaxConsecutiveKinkFactors;
  const bool is_truncated = options_.work_budget > 0 || options_.max_iterations < kFewIterations;
  int revisions = 0;
  bool is_revised = false;  // after the last iteration
  double best_energy = 0;
  double moved_before = 0;
  double contraction = 0;
  double remaining_move = std::numeric_limits<double>::infinity();  // relative to the tolerance
  const auto has_converged = [&] {
    return options_.max_iterations > 1 && report.residual <= options_.residual_tolerance && remaining_move <= 1;
  };
  // Work of an iteration: with the last factor, with a factor renewed in the terms with kinks, and with a new Hessian
  // and factor.
  const double reuse_work = work_.solve + work_.evaluation;
  const double kinks_work = work_.contact_blocks + kKinkFraction * work_.whole_factor + reuse_work;
  const double whole_work = work_.linearisation + work_.whole_factor + reuse_work;
  // The work of one solve of contact alone is reserved for the end.
  const double reserved = touches ? work_.contact_blocks + work_.evaluation : 0.0;
  const auto remaining_work = [&] {
    return options_.work_budget > 0 ? options_.work_budget - reserved - report.work
                                    : std::numeric_limits<double>::infinity();
  };
  const auto has_whole_factor = [&] { return report.factorisations > report.kink_factors; };
  report.status = StepStatus::iteration_limit;
  if (!evaluate(state, report, linearised, false)) return give_up();
  if (!continues_chord_step) {
    for (std::size_t t = 0; t < report.term_count; ++t) report.terms[t].start = report.terms[t].joules;
  }
  for (std::int64_t iteration = 0; iteration < options_.max_iterations; ++iteration) {
    if (has_converged()) {
      report.status = StepStatus::converged;
      break;
    }
    if (iteration > 0) {
      if (!have_best || report.energy < best_energy) {
        best_ = state;
        best_energy = report.energy;
        have_best = true;
      }
    }
    bool renews = !reuses_factor;
    bool renews_kinks = renews && may_reuse && has_smooth_ && first_kinked_ < order_.size() &&
                        consecutive_kink_factors < kMaxConsecutiveKinkFactors && !in_double;
    if (const double remaining = remaining_work();
        (iteration > 0 || (continues_chord_step && report.iterations > 0)) && std::isfinite(remaining)) {
      // A new Hessian and factor gains most. So its work is reserved until the step has had one. After that, all
      // remaining work may be spent.
      const double reserve = has_whole_factor() ? 0.0 : whole_work;
      const bool affords_whole = remaining >= whole_work;
      if (!renews && !has_whole_factor() && affords_whole && remaining - reuse_work < whole_work &&
          iterations_until(remaining_move, 1, contraction) * reuse_work > remaining)
        renews = true;
      if (renews_kinks && remaining < kinks_work + reserve) renews_kinks = !affords_whole && remaining >= kinks_work;
      if (renews && !renews_kinks && !affords_whole) renews = false;
      // If a chord step did not factorise in this step, its factor is not usable here.
      const bool has_factor = iteration > 0 || report.factorisations > 0;
      // The last factor lacks the contacts of a revision. Its direction would go into the object.
      if (remaining < reuse_work || (!renews && (!has_factor || is_revised))) {
        report.status = StepStatus::budget_spent;
        break;
      }
    }
    const bool last = iteration + 1 == options_.max_iterations;
    evaluated = !last || options_.measure_result || have_best;
    const double before = report.residual;
    double scale = 0;
    bool factorised = true;
    // Usually one pass. If a reused factor makes no progress, retry with a new factor. If that fails too, retry in
    // double.
    for (;;) {
      if (renews_kinks) renews_kinks = renew_kinks(state, report);
      if (renews && !renews_kinks) {
        if (!linearised) evaluate(state, report, true);
        factorised = factorize(state, report, in_double);
        if (!factorised) break;
        if (may_be_chord) linkage_.set_earlier_state(state);
      }
      const double solve_begin = clock_();
      gradient_ = -gradient_;
      factor_->solve(gradient_, direction_);
      gradient_ = -gradient_;
      report.timing.solve += clock_() - solve_begin;
      report.work += work_.solve;
      if (!direction_.allFinite()) return give_up();
      report.increment = direction_.size() > 0 ? direction_.lpNorm<Eigen::Infinity>() : 0.0;
      linearised = !last && !may_reuse && kUsualReduction * report.residual > options_.residual_tolerance;
      if (!options_.line_search) break;
      scale = search(state, report, evaluated, linearised);
      // If something else holds the tissue, it does not turn with its bone, and the way along the linkage is short.
      if (prepare_ && scale < kShortStep) linkage_.straighten();
      linearised = linearised && scale == 1;
      if (scale > 0 || (renews && !renews_kinks && (!precise_solver_ || factor_ == precise_solver_.get()))) break;
      if (iteration > 0 && remaining_work() < whole_work) break;
      if (renews && !renews_kinks) in_double = needs_double = true;
      renews = true;
      renews_kinks = false;
    }
    if (!factorised) {
      report.status = StepStatus::failed_factorisation;
      break;
    }
    if (scale == 0) {
      if (options_.line_search && iteration > 0) {
        if (remaining_work() < whole_work) report.status = StepStatus::budget_spent;
        report.increment = 0;
        break;
      }
      // The state is at a kink (the polar rotation jumps where s_2 + s_3 = 0). A full step leaves the kink. Without it,
      // the state would stay here for ever.
      move(state, 1);
      if (evaluated && !evaluate(state, report, linearised)) return give_up();
    }
    const double moved = (scale > 0 ? scale : 1.0) * largest_move(state);
    // With one factor, the increments shrink by a constant ratio. For a new factor, only the residual shows the
    // contraction.
    const double of_residual = before > 0 ? report.residual / before : 0.0;
    contraction = renews || moved_before == 0 ? of_residual : moved / moved_before;
    remaining_move = std::min(contraction, kSlowest) / (1 - std::min(contraction, kSlowest)) * moved;
    moved_before = moved;
    reuses_factor = may_reuse && scale == 1 &&
                    std::max(iterations_until(report.residual, options_.residual_tolerance, of_residual),
                             iterations_until(remaining_move, 1, contraction)) <= equivalent_iterations;
    consecutive_kink_factors = renews_kinks ? consecutive_kink_factors + 1 : 0;
    if (renews && !renews_kinks && scale == 1 && evaluated && report.residual > kStalled * before) {
      double_helps = double_helps && !in_double;
      in_double = needs_double || double_helps;
    }
    ++report.iterations;
    // A converged step is revised at its end only, so that its result does not depend on the way there.
    const bool may_be_last = is_truncated || has_converged() || report.increment <= options_.increment_tolerance;
    is_revised = may_be_last && revisions < kMaxRevisions && revise(state);
    if (is_revised) {
      ++revisions;
      touches = prepare_ && linkage_.any_touching();
      may_be_chord = may_be_chord && !touches;
      if (!evaluate(state, report, false)) return give_up();
      evaluated = true;
      linearised = have_best = reuses_factor = false;
      remaining_move = std::numeric_limits<double>::infinity();
      continue;
    }
    if (report.increment <= options_.increment_tolerance) {
      report.status = StepStatus::converged;
      break;
    }
  }
  if (evaluated && report.status == StepStatus::iteration_limit && has_converged()) {
    report.status = StepStatus::converged;
  }
  if (have_best && best_energy + rounding_of_energy(report) < report.energy) {
    // A line search only descends, so this happens only without line search.
    state = best_;
    evaluate(state, report, false);
  }
  if (report.status == StepStatus::failed_factorisation && report.iterations == 0) {
    state = start_;
    return report;
  }
  const bool is_cut_off = report.status == StepStatus::budget_spent ||
                          (report.status == StepStatus::iteration_limit && options_.max_iterations < kFewIterations);
  if (is_cut_off && touches && has_whole_factor() && report.shifts == 0) {
    if (!evaluated) {
      if (!evaluate(state, report, false)) return give_up();
      evaluated = true;
    }
    for (int k = 0; k < kContactSolves && solve_contact(state, report); ++k) {
      if (revise(state) && !evaluate(state, report, false)) return give_up();
    }
  }
  if (prepare_) is_predictable_ = linkage_.prediction_error(start_, state, time_step) <= kPredictable;
  const double end = clock_();
  for (Energy* term : terms_) term->end_step(state);
  report.timing.end = clock_() - end;
  if (!all_finite(state)) return give_up();
  // A failed step has no factor to reuse. A step that was cut off is far from the minimum: there only plain Newton
  // iterations make progress.
  was_cut_off_ = report.status == StepStatus::budget_spent;
  const bool is_reusable =
      report.status != StepStatus::failed_factorisation && report.status != StepStatus::budget_spent;
  if (is_reusable && (reuses_factor || has_whole_factor())) reusable_time_step_ = time_step;
  if (may_be_chord && has_whole_factor() && factor_ == linear_solver_.get() && report.shifts == 0)
    chord_time_step_ = time_step;
  report.state_changed = true;
  report.measured = evaluated;
  return report;
}

// Lets the terms change after an iteration (`Energy::revise`). Returns whether the energy has changed.
bool NewtonSolver::revise(const State& state) {
  bool changed = false;
  for (Energy* term : terms_) changed |= term->revise(state);
  if (changed && prepare_) prepare_(linkage_);
  return changed;
}

void NewtonSolver::use_linkage(Linkage linkage, std::function<bool(Linkage&)> prepare) {
  linkage_ = std::move(linkage);
  prepare_ = std::move(prepare);
}

void NewtonSolver::take_factor(const NewtonSolver& other) {
  const bool is_precise = other.factor_ == other.precise_solver_.get();
  LinearSolver* const mine = is_precise ? precise_solver_.get() : linear_solver_.get();
  if (mine == nullptr || !mine->take_factor(*other.factor_)) return;
  factor_ = mine;
  has_smooth_ = other.has_smooth_;
  if (has_smooth_) hessian_ = other.hessian_;
  linkage_ = other.linkage_;
  chord_time_step_ = other.chord_time_step_;
  reusable_time_step_ = other.reusable_time_step_;
  contracts_slowly_ = other.contracts_slowly_;
  is_predictable_ = other.is_predictable_;
  was_cut_off_ = other.was_cut_off_;
  potentials_ = other.potentials_;
  node_gradient_ = other.node_gradient_;
  previous_node_gradient_ = other.previous_node_gradient_;
  node_gradient_time_step_ = other.node_gradient_time_step_;
}

// Returns false if the iteration does not contract or if its work would exceed the budget. Then, if a state below the
// energy of the step's start was reached, `state` is the lowest such state and `report.chord` is set. Otherwise `state`
// is the step's start.
bool NewtonSolver::chord_step(State& state, double time_step, StepReport& report) {
  reusable_time_step_ = 0;
  if (measures_start_) {
    for (std::size_t t = 0; t < terms_.size(); ++t) report.terms[t].start = terms_[t]->value(state);
  }
  double before = 0;
  bool renews = contracts_slowly_ || chord_time_step_ != time_step;
  const bool has_potentials = has_potentials_of(state);
  const bool extrapolates = has_potentials && node_gradient_time_step_ == time_step && !renews;
  if (has_potentials) {
    previous_node_gradient_.swap(node_gradient_);
    node_gradient_ = potentials_.of_nodes;
    linkage_.to_bodies(state, node_gradient_);
  }
  node_gradient_time_step_ = has_potentials ? time_step : 0;
  // The least energy so far. It includes the start, from which an ordinary step would descend, and the predicted state,
  // if these are evaluated.
  double least = std::numeric_limits<double>::infinity();
  // The energy of `best_`. If the energy of the start is unknown, no state is known to lie below it.
  double lowest = -std::numeric_limits<double>::infinity();
  if (has_potentials) {
    if (!evaluate(state, report, false, false)) return false;
    for (std::size_t t = 0; t < report.term_count; ++t) report.terms[t].start = report.terms[t].joules;
    least = lowest = report.energy;
  }
  bool fell_below_start = false;
  const auto note_lowest = [&] {
    if (!(report.energy < lowest)) return;
    lowest = report.energy;
    best_ = state;
    fell_below_start = true;
  };
  const auto give_up = [&] {
    state = fell_below_start ? best_ : start_;
    report.chord = fell_below_start;
    return false;
  };
  linkage_.coast(state, time_step);
  if (extrapolates) {
    extrapolated_ = 2 * node_gradient_ - previous_node_gradient_;
    linkage_.to_world(state, extrapolated_);
  }
  if (!evaluate(state, report, renews, false, extrapolates ? &extrapolated_ : nullptr)) return give_up();
  if (!extrapolates) {
    least = std::min(least, report.energy);
    note_lowest();
  }
  const double iteration_work = work_.solve + work_.evaluation;
  for (int iteration = 0; iteration < kMaxChordIterations; ++iteration) {
    if (options_.work_budget > 0 &&
        report.work + iteration_work + (renews ? work_.whole_factor : 0.0) > options_.work_budget)
      return give_up();
    if (renews) {
      if (!factorize(state, report, false) || report.shifts > 0) return give_up();
      linkage_.set_earlier_state(state);
      chord_time_step_ = time_step;
    }
    const double begin = clock_();
    gradient_ = -gradient_;
    linkage_.set_later_state(state);
    linkage_.to_then(gradient_);
    factor_->solve(gradient_, direction_);
    linkage_.to_now(direction_);
    report.timing.solve += clock_() - begin;
    report.work += work_.solve;
    if (!direction_.allFinite()) return give_up();
    move(state, 1);
    ++report.iterations;
    report.increment = direction_.lpNorm<Eigen::Infinity>();
    const double moved = linkage_.root_mean_square(direction_);
    const bool stalled = iteration > 0 && renews && moved > kStalled * before;
    contracts_slowly_ = iteration > 0 ? moved > kSlowContraction * before : contracts_slowly_ && !renews;
    const bool moved_little = moved <= options_.chord_tolerance;
    const bool renewed = std::exchange(renews, !moved_little && contracts_slowly_ && !stalled);
    const double residual = report.residual;
    if (!evaluate(state, report, renews, moved_little)) return give_up();
    // Small increments can raise the energy much if the reused factor lacks a stiffness, such as that beyond a strain
    // limit.
    const bool fell = report.energy <= least + rounding_of_energy(report) + kNoEnergy;
    least = std::min(least, report.energy);
    note_lowest();
    if (stalled) return give_up();
    // With a factor that is much too stiff the increments are small, however large the residual is.
    const bool shrank = report.residual <= std::max(options_.residual_tolerance, kStalled * residual);
    if (moved_little && fell && shrank) {
      if (revise(state)) {
        fell_below_start = false;
        return give_up();
      }
      const double end = clock_();
      for (Energy* term : terms_) term->end_step(state);
      report.timing.end = clock_() - end;
      report.status = StepStatus::converged;
      report.state_changed = all_finite(state);
      report.chord = true;
      report.measured = true;
      is_predictable_ = linkage_.prediction_error(start_, state, time_step) <= kPredictable;
      was_cut_off_ = false;
      return report.state_changed;
    }
    before = moved;
    if (!shrank && !renewed && !renews) {
      renews = true;
      before = std::numeric_limits<double>::infinity();  // not comparable with the increments of a better factor
      if (!evaluate(state, report, true, false)) return give_up();
    }
  }
  return give_up();
}

}  // namespace softhand
