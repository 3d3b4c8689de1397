// The step: minimises the incremental potential E(q) = inertia + U(q) of a list of terms (ES2725128A1 eqs. 10-17).
// Inertia is one of the terms.
//
// NewtonSolver makes the step, and in it Newton's iterations. These modules help it.
// IncrementalPotential evaluates E, its gradient and its Hessian from the terms.
// HessianFactor holds the factor of the Hessian, in float or double.
// FactorPolicy decides when a factor is renewed, and when the work budget ends the step.
// LineSearch searches on E along the direction of an iteration.
// Predictor makes chord steps, which are steps in free motion without a new Hessian.
// Linkage moves bones by finite rotations, and tissue with its bone.
// LooseSolve solves with a Hessian that has blocks outside the pattern of the factor, from contact of skin with skin.
// CondensedNewton solves contact on the condensed hand. LocalNewton solves contact alone, at the end of a truncated
// step. MovingBlocks are the unknowns that these two move. Compliance holds how the touched nodes give way to forces on
// each other, under the last factor. NonlinearElimination brings a few nodes with large residual forces into balance.
//
// Each module that hands something from a step to the next keeps it in one value, `Carried`.
//
// max_iterations = 1 is the source's fast mode: one Newton step from q_i (eq. 16). Every Newton step is followed by a
// line search on E, also in the fast mode. Without it, one or two Newton steps jump back and forth over the kink
// between sticking and sliding. Then a resting object creeps, and a gripped object is thrown.
#pragma once

#include <functional>
#include <vector>

#include "energies/energy.hpp"
#include "solver/condensed_newton.hpp"
#include "solver/factor_policy.hpp"
#include "solver/hessian_factor.hpp"
#include "solver/incremental_potential.hpp"
#include "solver/line_search.hpp"
#include "solver/linkage.hpp"
#include "solver/local_newton.hpp"
#include "solver/loose_solve.hpp"
#include "solver/nonlinear_elimination.hpp"
#include "solver/predictor.hpp"
#include "solver/solver_options.hpp"
#include "solver/step_report.hpp"

namespace softhand {

class NewtonSolver {
 public:
  /// Builds the pattern of the terms, binds them and analyses the pattern once. The terms must outlive the solver.
  /// Their order is the order of summation. Throws std::invalid_argument if there are more than kMaxTerms terms or an
  /// option is out of range.
  NewtonSolver(std::vector<Energy*> terms, DofLayout layout, const SolverOptions& options);

  /// Moves `state` by `time_step` seconds. 0 is a bitwise no-op (`converged`). Throws nothing. Never leaves NaN or
  /// infinity in `state`. A step that fails leaves `state` as it was, and calls `forget`. Allocates nothing outside the
  /// linear solver.
  StepReport step(State& state, double time_step);

  /// `taken`: compute `TermEnergy::taken`, for the energy ledger. `start_of_chord_steps`: chord steps evaluate
  /// `TermEnergy::start` too, which they do not need themselves. Both are off at first.
  void measure_work(bool taken, bool start_of_chord_steps) { potential_.measure_work(taken, start_of_chord_steps); }
  /// Iterations move the state along `linkage`. `prepare` is called once the terms have begun a step. It marks the
  /// touching bodies in the linkage, and returns whether the step may be a chord step. It must not allocate.
  ///
  /// A chord step starts from the state predicted from the velocities of linked bodies and nodes. It uses Newton's
  /// method with the Hessian of an earlier step, rotated by the linkage. If it does not contract, an ordinary step
  /// follows. So `prepare` must return true only if the Hessian changes almost only by the rotation of the linked
  /// bodies: no contact began or ended.
  ///
  /// `guess` moves the state at the start of a step to where the step may end. It is called if something touches, and
  /// with a work budget in every step. The iterations of an ordinary step begin there if energy and residual are
  /// smaller. Surfaces that the guess crosses get contacts, if velocities do not predict it. It returns false if the
  /// state hardly moves. It must not allocate.
  using Guess = std::function<bool(const Linkage& linkage, double time_step, State& state)>;
  void use_linkage(Linkage linkage, std::function<bool(Linkage&)> prepare, Guess guess = {});

  /// Work budget of the later steps, in fast steps, > 0. Only for a solver whose options have a work budget.
  void set_work_budget(double work_budget) {
    options_.work_budget = work_budget;
    policy_.set_work_budget(work_budget);
    predictor_.set_work_budget(work_budget);
  }

  /// Call between steps. Takes over the factor of `other` and all else that a step hands to the next, so that both
  /// continue alike. `other` must have the same terms and the same sparsity pattern. Does nothing if the linear solvers
  /// differ in kind.
  void take_factor(const NewtonSolver& other);

  /// Call between steps. Drops the factor and all else that a step hands to the next. The next step then depends only
  /// on its state and its terms, as the first step of a new solver does. Does not allocate.
  void forget();

  const BlockMatrix& hessian() const { return potential_.hessian(); }  ///< at the last linearisation

 private:
  bool make_guess(const State& state, double time_step);
  bool evaluate_first(State& state, bool has_guess, bool continues, bool hessian, StepMeter& meter);
  bool minimise(State& state, double time_step, bool may_be_chord, bool has_guess, bool continues, StepMeter& meter);
  bool revise(const State& state);
  bool retreat(State& state, StepMeter& meter);
  double largest_move(const State& state, bool condenses) const;
  enum class Moved : std::uint8_t { yes, no, not_finite };
  Moved move_touched(State& state, bool objects_only, StepMeter& meter);
  bool solve_contact(State& state, StepMeter& meter);
  Moved relieve_nodes(State& state, bool condenses, StepMeter& meter);
  bool find_direction(const State& state, bool condenses, StepMeter& meter);

  SolverOptions options_;
  DofLayout layout_;
  std::function<double()> clock_;
  IncrementalPotential potential_;
  HessianFactor factor_;
  StepWork prices_;
  FactorPolicy policy_;
  LineSearch line_search_;
  Predictor predictor_;
  Linkage linkage_;
  std::function<bool(Linkage&)> prepare_;  // null: no chord steps
  Guess guess_;                            // null: the iterations begin at the start of the step
  LooseSolve loose_solve_;
  LocalNewton local_newton_;
  NonlinearElimination elimination_;
  CondensedNewton condensed_newton_;
  int room_;               // of `compliance_`, blocks
  Compliance compliance_;  // of the last factor, if it is without terms with kinks
  VectorX pull_, direction_, relief_;
  State best_;
};

}  // namespace softhand
