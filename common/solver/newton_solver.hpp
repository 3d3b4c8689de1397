// The step: minimises the incremental potential E(q) = inertia + U(q) of a list of terms (ES2725128A1 eqs. 10-17).
// Inertia is one of the terms.
//
// A step begins with what potentials were where the last one ended. While nothing touches the hand, most of the rest is
// left out too: a chord step starts from where velocities lead, with the tissue's forces where those of the last two
// ends lead, and reuses an earlier step's factor, turned along with the bones (linkage.hpp). Where that does not
// converge, an ordinary step goes on from the lowest state it reached. In contact a factor is kept from one iteration
// to the next, and from the last of a step to the first of the next, while that gets there sooner; then the part of
// contact and friction is renewed, with the fronts above what is touched, and only then the rest. None of it is in the
// source.
//
// A step may have a budget of work. It first keeps the work of one new Hessian and factor in reserve, and spends the
// rest on iterations that cost less. The step after one that was cut off takes Newton's own iterations alone.
//
// max_iterations = 1 is the text's fast mode, one Newton step from q_i (eq. 16). Every step, that one too, is followed
// by a line search on E: without it one or two steps jump to and fro over the kink between sticking and sliding, and a
// resting object creeps or a gripped one is hurled.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "energies/energy.hpp"
#include "math/helper_thread.hpp"
#include "runtime/options.hpp"
#include "solver/linear_solver.hpp"
#include "solver/linkage.hpp"
#include "solver/local_newton.hpp"
#include "solver/step_work.hpp"

namespace softhand {

struct SolverOptions {
  std::int64_t max_iterations = 60;
  bool keep_factor = true;
  double residual_tolerance = 1e-3;
  double movement_tolerance = 5e-6;
  double increment_tolerance = 1e-9;
  double work_budget = 0;
  double chord_tolerance = 2e-5;
  bool line_search = true;
  bool measure_result = true;
  std::string curvature = "adaptive";
  std::string factor = "float";
  // What a program sets, not a file.
  std::function<std::unique_ptr<LinearSolver>()>
      linear_solver;               ///< makes what solves the systems; empty: the block factorisation, as `factor` says
  HelperThread* helper = nullptr;  ///< shares the block factorisation; outlives the solver
  std::function<double()> clock;   ///< seconds from any origin; empty: a steady clock
};

inline void describe(OptionVisitor& v, SolverOptions& o) {
  v.integer("max_iterations", o.max_iterations, "", {1, 10000},
            "Newton iterations a step; 1 is the fast mode of the method: it holds, but a gripped light object trembles "
            "where the tracker is noisy.");
  v.flag("keep_factor", o.keep_factor,
         "An iteration goes on with the factor of the one before, the first with that of the step before, while so it "
         "gets there sooner than with a new Hessian and factor; then contact and friction "
         "are renewed, and only then the rest. With three iterations and more.");
  v.number("residual_tolerance", o.residual_tolerance, "N", {0, 1e6},
           "Converged when no force (N) or torque (N m) left over exceeds this,");
  v.number("movement_tolerance", o.movement_tolerance, "m", {0, 1},
           "and no node and no body would move by more than this: what is light and soft moves far for little force. A "
           "body that moves or turns "
           "by less than 50 mm in the step must be nearer, in proportion, down to 10 um. Estimated from how the "
           "iterations shrank.");
  v.number("increment_tolerance", o.increment_tolerance, "m", {0, 1},
           "Converged too when an iteration moves nothing by more than this (m, rad).");
  v.number("work_budget", o.work_budget, "fast steps", {0, 1e6},
           "Work of a step, in fast steps of this hand (one evaluation, factorisation and solve). Starts no iteration "
           "that would "
           "exceed it, except the first. 0: unlimited; `softhand-hand` then takes what 0.6 of its period is worth on "
           "this machine.");
  v.number("chord_tolerance", o.chord_tolerance, "m", {0, 1e-2},
           "While nothing touches the hand a step starts from where its velocity takes it and keeps the factor of an "
           "earlier step, until an iteration moves tissue and bones by no more "
           "than this (root mean square); what is left is a fraction of it. 0: never.");
  v.flag("line_search", o.line_search,
         "On the energy, along each iteration's direction. Without it, one or two iterations hurl gripped objects.");
  v.flag("measure_result", o.measure_result,
         "Evaluate energy and residual of the result; without it a fast step reports those it started from.");
  v.choice("curvature", o.curvature, {"adaptive", "projected", "exact"},
           "Hessian of the terms. adaptive: that of tissue, attachments and joints is exact where the whole is "
           "positive definite "
           "and the work has no budget, else projected. projected: to be positive semi-definite. exact: that of the "
           "text's eq. 16, which may need a diagonal shift.");
  v.choice("factor", o.factor, {"float", "double"},
           "Precision of the factor and of the products in the tissue's Hessian. Energy, gradient and residual are "
           "double either way, so that float costs convergence at most; where a float factor fails or leads nowhere, "
           "the step takes double.");
}

enum class StepStatus : std::uint8_t {
  converged,             ///< by residual or increment
  iteration_limit,       ///< all iterations done, or no further descent in floating point; normal for the fast mode
  budget_spent,          ///< stopped by the work budget
  failed_factorisation,  ///< not positive definite even when shifted; the state is the best one before, or unchanged
  nonfinite,             ///< a number overflowed; the state is the one before the step
  refused,  ///< time step negative or not finite, or a state that is not finite or not of this layout; nothing was done
};
std::string_view to_string(StepStatus status);

/// Seconds, by the solver's clock.
struct StepTiming {
  double begin = 0;     ///< begin_step of all terms: contact detection
  double energies = 0;  ///< values, gradients, Hessians with their scatter; the line search
  double assembly = 0;  ///< clearing and gathering the matrix
  double factorisation = 0;
  double solve = 0;
  double end = 0;  ///< end_step of all terms
  double total() const { return begin + energies + assembly + factorisation + solve + end; }
};

inline constexpr std::size_t kMaxTerms = 16;

struct TermEnergy {
  std::string_view name;
  double joules = 0;
  double start = 0;  ///< the same at the step's start, J; of a chord step 0 unless asked for
  double taken = 0;  ///< gradient . dq, dq the step's whole increment, J; 0 unless asked for
};

struct StepReport {
  StepStatus status = StepStatus::refused;
  int iterations = 0;      ///< Newton steps taken
  int factorisations = 0;  ///< of new Hessians; the other iterations kept the last factor, or that of the step before
  int kink_factors = 0;    ///< of them, new in the terms with kinks alone
  int contact_solves = 0;  ///< of contact alone, after the last iteration (LocalNewton)
  int double_factors = 0;  ///< of them, taken in double because the float factor failed, or led nowhere
  double residual = 0;     ///< largest |dE/dq|, N and N m
  double increment = 0;    ///< largest move of the last iteration, m and rad
  double energy = 0;       ///< E, J
  bool state_changed = false;  ///< the step was taken, velocities included; false: `state` is bitwise what it was
  bool measured = false;       ///< energy, residual and terms are those of the result
  double work = 0;             ///< fast steps (step_work.hpp)
  int shifts = 0;              ///< factorisations repeated with a diagonal shift
  bool chord = false;          ///< the step was a chord step (`allow_chord_steps`)
  std::size_t term_count = 0;
  std::array<TermEnergy, kMaxTerms> terms{};  ///< E by term, the first `term_count`
  StepTiming timing;
};

class NewtonSolver {
 public:
  /// Builds the pattern of the terms, binds them, analyses once. The terms outlive the solver; their order is the order
  /// of summation. std::invalid_argument for more than kMaxTerms terms or options out of range.
  NewtonSolver(std::vector<Energy*> terms, DofLayout layout, const SolverOptions& options);

  /// Moves `state` by `time_step` seconds. 0 is a bitwise no-op (`converged`). Throws nothing; never leaves a number in
  /// `state` that is not finite. Allocates nothing outside the linear solver.
  StepReport step(State& state, double time_step);

  /// Whether `TermEnergy::taken` is computed, for the energy ledger, and whether a chord step, which has no use for it,
  /// evaluates `TermEnergy::start`; off at first.
  void measure_work(bool taken, bool start_of_chord_steps) {
    measures_work_ = taken;
    measures_start_ = start_of_chord_steps;
  }
  /// Iterations move the state along `linkage`. `prepare` is called once the terms have begun a step. It marks the
  /// touching bodies in the linkage, and returns whether the step may be a chord step. It must not allocate.
  ///
  /// A chord step starts from the state to which the velocities of linked bodies and nodes lead, and uses Newton's
  /// method with the Hessian of an earlier chord step, turned along by the linkage. If it does not contract, an
  /// ordinary step follows from the start. So `prepare` must return true only if the Hessian changes by little else
  /// than the turning of the linked bodies: no contact began or ended.
  void use_linkage(Linkage linkage, std::function<bool(Linkage&)> prepare);

  /// Between steps: goes on with the factor that `other`, of as many terms of the same pattern, would go on with, and
  /// what else it kept, where both have linear solvers of one kind; else with its own.
  void take_factor(const NewtonSolver& other);

  const BlockMatrix& hessian() const { return hessian_; }  ///< at the last linearisation

 private:
  bool evaluate(const State& state, StepReport& report, bool with_hessian, bool may_be_result = true,
                const VectorX* carried = nullptr);
  bool knows_potentials(const State& state) const;
  void measure_displacement(const State& state);
  double energy_at(const State& state, StepReport& report) const;
  bool factorize(const State& state, StepReport& report, bool in_double);
  void count_factor(StepReport& report) const;
  bool renew_kinks(const State& state, StepReport& report);
  bool chord_step(State& state, double time_step, StepReport& report);
  double search(State& state, StepReport& report, bool measured, bool with_hessian);
  double largest_move(const State& state) const;
  void move(State& state, double scale);
  bool solve_contact(State& state, StepReport& report);

  std::vector<Energy*> terms_;
  std::vector<std::size_t> order_;  // of evaluation: potentials first, so that their part of the gradient can be kept;
                                    // those with kinks last, so that theirs of the Hessian can be taken back
  std::size_t first_bodily_ = 0, first_frozen_ = 0,
              first_kinked_ =
                  0;  // in `order_`: of potentials that touch bodies, after the potentials, of those with kinks
  DofLayout layout_;
  SolverOptions options_;
  Curvature curvature_;
  bool tries_exact_;      // of terms without kinks, as long as the float factor takes it
  bool tries_exact_now_;  // in the next evaluation with a Hessian
  bool hessian_is_exact_ = false;
  StepWork work_;
  bool was_cut_off_ = false;  // the last step, by the budget
  std::unique_ptr<LinearSolver> linear_solver_;
  LocalNewton local_newton_;
  std::vector<Energy*> kinked_;  // the terms with kinks
  Linkage linkage_;
  std::function<bool(Linkage&)> prepare_;  // null: no linkage
  // Chord steps.
  bool is_predictable_ = true;     // the last step ended near where velocities led
  double kept_time_step_ = 0;      // of the factor in `linear_solver_`; 0: it is not for chord steps
  bool contracts_slowly_ = false;  // the factor contracted slowly when last used
  double carried_time_step_ = 0;   // of the factor that the last step left, unless it was a chord step's; 0: none
  std::unique_ptr<LinearSolver> precise_solver_;  // takes over where a float factor does not do; null without one
  LinearSolver* factor_ = nullptr;                // which of the two holds the last factor
  std::function<double()> clock_;
  BlockMatrix hessian_;
  bool has_smooth_ = false;             // the last factor is that of `hessian_`, whose journal is the terms' with kinks
  std::vector<std::int32_t> changed_;   // stored blocks
  std::vector<std::int32_t> diagonal_;  // stored block of each diagonal block
  // Of chord steps: potentials_.of_nodes at the start of this one and of the one before, in the axes of the bodies that
  // carry the nodes, and where the two lead.
  VectorX carried_, carried_before_, extrapolated_;
  double carried_for_ = 0;  // seconds, the step of `carried_`; 0: it says nothing of the next one
  VectorX gradient_, direction_;
  VectorX tangent_;       // derivative of `move` by its scale, at the last move
  VectorX displacement_;  // the increment from start_ to the state evaluated last
  // What the potentials were where they were evaluated last: mostly the start of the next step.
  struct Potentials {
    std::size_t bodies = 0;  // on which they depend: the first ones
    bool known = false;
    Eigen::Matrix3Xd positions;
    std::vector<Pose> poses;
    VectorX gradient;
    VectorX of_nodes;                        // likewise of those that touch no body
    std::array<double, kMaxTerms> joules{};  // by place in `order_`
  } potentials_;
  State start_, base_, best_;
  bool measures_work_ = false;
  bool measures_start_ = false;
};

}  // namespace softhand
