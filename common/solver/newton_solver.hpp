// The step: minimises the incremental potential E(q) = inertia + U(q) of a list of terms (ES2725128A1 eqs. 10-17).
// Inertia is one of the terms.
//
// Additions to the source that save work:
// - Potentials are not evaluated again at the start of a step: their values at the end of the last step are reused.
// - While nothing touches the hand, a step may be a chord step. A chord step starts from the state predicted from the
//   velocities. It extrapolates the tissue forces from the ends of the last two steps. It reuses the factor of an
//   earlier step, rotated with the bones (linkage.hpp). If it does not converge, an ordinary step continues from the
//   lowest state that it reached.
// - In contact a factor is reused while this converges sooner than a new factor. The last factor of a step also serves
//   the first iteration of the next step. If reuse is too slow, only the part of contact and friction is renewed, with
//   the fronts above the touched blocks. The rest is renewed only if this is not enough.
//
// A step may have a work budget. At first the step reserves the work of one new Hessian and factor. It spends the rest
// on cheaper iterations. After a step that was cut off by the budget, the next step uses no reused factor: it takes
// plain Newton iterations.
//
// Additions to the source that make iterations better:
// - Bones move by finite rotations, and tissue turns with its bone (linkage.hpp).
// - If the budget or a limit of one or two iterations ends a step in contact, a solve of contact alone follows
//   (local_newton.hpp).
//
// max_iterations = 1 is the source's fast mode: one Newton step from q_i (eq. 16). Every Newton step is followed by a
// line search on E, also in the fast mode. Without it, one or two Newton steps jump back and forth over the kink
// between sticking and sliding. Then a resting object creeps, and a gripped object is thrown.
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
  // Set by the program; not readable from a configuration file.
  /// Creates the linear solver. Empty: BlockCholesky with the precision `factor`.
  std::function<std::unique_ptr<LinearSolver>()> linear_solver;
  HelperThread* helper = nullptr;  ///< shares the block factorisation; must outlive the solver
  std::function<double()> clock;   ///< seconds from any origin; empty: a steady clock
};

inline void describe(OptionVisitor& v, SolverOptions& o) {
  v.integer("max_iterations", o.max_iterations, "", {1, 10000},
            "Newton iterations per step. 1 is the fast mode of the method: grasps hold, but a gripped light object "
            "trembles if the tracker is noisy.");
  v.flag("keep_factor", o.keep_factor,
         "Reuse the factor of the last iteration or of the last step while this converges sooner than a new Hessian "
         "and factor. Then contact and friction are renewed first, and the rest only if needed. Needs at least three "
         "iterations per step.");
  v.number(
      "residual_tolerance", o.residual_tolerance, "N", {0, 1e6},
      "A step has converged if no residual force (N) or torque (N m) exceeds this and `movement_tolerance` is met.");
  v.number("movement_tolerance", o.movement_tolerance, "m", {0, 1},
           "A step has converged if no node and no body would move by more than this and `residual_tolerance` is met. "
           "Light and soft parts move far under little force. If a body moves or turns by less than 50 mm in the step, "
           "its tolerance shrinks in proportion, down to 10 um. The remaining movement is estimated from the "
           "contraction of the iterations.");
  v.number("increment_tolerance", o.increment_tolerance, "m", {0, 1},
           "A step has also converged if an iteration moves nothing by more than this (m, rad).");
  v.number("work_budget", o.work_budget, "fast steps", {0, 1e6},
           "Work of a step, in fast steps of this hand (one evaluation, factorisation and solve). No iteration starts "
           "that would exceed the budget, except the first. 0: unlimited; `softhand-hand` then uses the work that this "
           "machine does in 0.6 of its period.");
  v.number("chord_tolerance", o.chord_tolerance, "m", {0, 1e-2},
           "While nothing touches the hand, a step starts from the state predicted from velocities and reuses the "
           "factor of an earlier step. It ends when an iteration moves tissue and bones by no more than this (root "
           "mean square). The remaining error is a fraction of this. 0: never.");
  v.flag("line_search", o.line_search,
         "Search along each iteration's direction, on the energy. Without it, steps of one or two iterations throw "
         "gripped objects.");
  v.flag("measure_result", o.measure_result,
         "Evaluate energy and residual of the result. Without it, a fast step reports those of its start.");
  v.choice("curvature", o.curvature, {"adaptive", "projected", "exact"},
           "Hessian of the terms. 'projected' makes it positive semi-definite. 'exact' takes the Hessian of eq. 16 of "
           "the source, which may need a diagonal shift. 'adaptive' takes the exact Hessian of tissue, attachments and "
           "joints while the whole is positive definite. With a work budget, or with fewer than 3 iterations, "
           "'adaptive' is 'projected'.");
  v.choice("factor", o.factor, {"float", "double"},
           "Precision of the factor and of the products in the tissue's Hessian. Energy, gradient and residual are "
           "always double, so float can only slow down convergence. If a float factor fails or makes no progress, the "
           "step uses double.");
}

enum class StepStatus : std::uint8_t {
  converged,             ///< by residual or increment
  iteration_limit,       ///< all iterations done, or no further descent in floating point; normal for the fast mode
  budget_spent,          ///< stopped by the work budget
  failed_factorisation,  ///< not positive definite even when shifted; the state is the best one so far, or unchanged
  nonfinite,             ///< NaN or infinity; the state is the one before the step
  refused,               ///< bad time step, or the state is not finite or has another layout; nothing was done
};
std::string_view to_string(StepStatus status);

/// Seconds on the solver's clock.
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
  double start = 0;  ///< the same at the step's start, J; 0 after a chord step unless requested (`measure_work`)
  double taken = 0;  ///< gradient . dq, dq the step's whole increment, J; 0 unless requested (`measure_work`)
};

struct StepReport {
  StepStatus status = StepStatus::refused;
  int iterations = 0;      ///< Newton steps taken
  int factorisations = 0;  ///< of new Hessians; the other iterations reused a factor of this step or an earlier one
  int kink_factors = 0;    ///< among `factorisations`: only the terms with kinks were new
  int contact_solves = 0;  ///< solves of contact alone, after the last iteration (LocalNewton)
  int double_factors = 0;  ///< among `factorisations`: in double because the float factor failed or made no progress
  double residual = 0;     ///< largest |dE/dq|, N and N m
  double increment = 0;    ///< largest move of the last iteration, m and rad
  double energy = 0;       ///< E, J
  bool state_changed = false;  ///< the step was taken, velocities included; false: `state` is bitwise unchanged
  bool measured = false;       ///< energy, residual and terms are those of the result
  double work = 0;             ///< in fast steps (step_work.hpp)
  int shifts = 0;              ///< factorisations repeated with a diagonal shift
  bool chord = false;          ///< the step was a chord step (`allow_chord_steps`)
  std::size_t term_count = 0;
  std::array<TermEnergy, kMaxTerms> terms{};  ///< E by term, the first `term_count`
  StepTiming timing;
};

class NewtonSolver {
 public:
  /// Builds the pattern of the terms, binds them and analyses the pattern once. The terms must outlive the solver.
  /// Their order is the order of summation. Throws std::invalid_argument if there are more than kMaxTerms terms or an
  /// option is out of range.
  NewtonSolver(std::vector<Energy*> terms, DofLayout layout, const SolverOptions& options);

  /// Moves `state` by `time_step` seconds. 0 is a bitwise no-op (`converged`). Throws nothing. Never leaves NaN or
  /// infinity in `state`. Allocates nothing outside the linear solver.
  StepReport step(State& state, double time_step);

  /// `taken`: compute `TermEnergy::taken`, for the energy ledger. `start_of_chord_steps`: chord steps evaluate
  /// `TermEnergy::start` too, which they do not need themselves. Both are off at first.
  void measure_work(bool taken, bool start_of_chord_steps) {
    measures_work_ = taken;
    measures_start_ = start_of_chord_steps;
  }
  /// Iterations move the state along `linkage`. `prepare` is called once the terms have begun a step. It marks the
  /// touching bodies in the linkage, and returns whether the step may be a chord step. It must not allocate.
  ///
  /// A chord step starts from the state predicted from the velocities of linked bodies and nodes. It uses Newton's
  /// method with the Hessian of an earlier step, rotated by the linkage. If it does not contract, an ordinary step
  /// follows. So `prepare` must return true only if the Hessian changes almost only by the rotation of the linked
  /// bodies: no contact began or ended.
  void use_linkage(Linkage linkage, std::function<bool(Linkage&)> prepare);

  /// Call between steps. Takes over the factor of `other` and its other stored data, so that both continue alike.
  /// `other` must have the same terms and the same sparsity pattern. Does nothing if the linear solvers differ in kind.
  void take_factor(const NewtonSolver& other);

  const BlockMatrix& hessian() const { return hessian_; }  ///< at the last linearisation

 private:
  bool evaluate(const State& state, StepReport& report, bool with_hessian, bool may_be_result = true,
                const VectorX* extrapolated = nullptr);
  bool has_potentials_of(const State& state) const;
  void measure_displacement(const State& state);
  double energy_at(const State& state, StepReport& report) const;
  bool factorize(const State& state, StepReport& report, bool in_double);
  void count_factor(StepReport& report) const;
  bool renew_kinks(const State& state, StepReport& report);
  bool chord_step(State& state, double time_step, StepReport& report);
  double search(State& state, StepReport& report, bool measured, bool with_hessian);
  double largest_move(const State& state) const;
  bool revise(const State& state);
  void move(State& state, double scale);
  bool solve_contact(State& state, StepReport& report);

  std::vector<Energy*> terms_;
  // Order of evaluation of the terms. Potentials come first, so that their part of the gradient can be reused. Terms
  // with kinks come last, so that their part of the Hessian can be removed again.
  std::vector<std::size_t> order_;
  // Places in `order_`: the first potential that depends on bodies, the first term after the potentials, and the first
  // term with kinks.
  std::size_t first_bodily_ = 0, first_frozen_ = 0, first_kinked_ = 0;
  DofLayout layout_;
  SolverOptions options_;
  Curvature curvature_;
  bool tries_exact_;      // use the exact Hessian of terms without kinks while it is positive definite
  bool tries_exact_now_;  // the same, in the next evaluation with a Hessian
  bool hessian_is_exact_ = false;
  StepWork work_;
  bool was_cut_off_ = false;  // the budget stopped the last step
  std::unique_ptr<LinearSolver> linear_solver_;
  LocalNewton local_newton_;
  std::vector<Energy*> kinked_;  // the terms with kinks
  Linkage linkage_;
  std::function<bool(Linkage&)> prepare_;  // null: no linkage
  // Chord steps.
  bool is_predictable_ = true;     // the last step ended near the state predicted from velocities
  double chord_time_step_ = 0;     // time step of the factor in `linear_solver_`; 0: not usable for chord steps
  bool contracts_slowly_ = false;  // the factor contracted slowly when last used
  double reusable_time_step_ = 0;  // time step of the factor of the last ordinary step; 0: none to reuse
  std::unique_ptr<LinearSolver> precise_solver_;  // fallback in double for a float factor; else null
  LinearSolver* factor_ = nullptr;                // the solver of these two that holds the last factor
  std::function<double()> clock_;
  BlockMatrix hessian_;
  bool has_smooth_ = false;  // the last factor is that of `hessian_`, and the journal has the terms with kinks
  std::vector<std::int32_t> changed_;   // stored blocks
  std::vector<std::int32_t> diagonal_;  // stored block of each diagonal block
  // For chord steps: `potentials_.of_nodes` at the start of this step and of the last step, in the axes of the nodes'
  // bodies, and the extrapolation of the two.
  VectorX node_gradient_, previous_node_gradient_, extrapolated_;
  double node_gradient_time_step_ = 0;  // s, the time step of `node_gradient_`; 0: it is not usable in the next step
  VectorX gradient_, direction_;
  VectorX tangent_;       // derivative of `move` with respect to its scale, at the last move
  VectorX displacement_;  // the increment from start_ to the state evaluated last
  // Values of the potentials at the state where they were evaluated last. Usually this is the start of the next step.
  struct Potentials {
    std::size_t bodies = 0;  // they depend on this many bodies: the first ones
    bool known = false;
    Eigen::Matrix3Xd positions;
    std::vector<Pose> poses;
    VectorX gradient;
    VectorX of_nodes;                        // the gradient of the potentials that depend on nodes only
    std::array<double, kMaxTerms> joules{};  // by place in `order_`
  } potentials_;
  State start_, base_, best_;
  bool measures_work_ = false;
  bool measures_start_ = false;
};

}  // namespace softhand
