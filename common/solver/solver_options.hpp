// The options of a solver, and what follows from them.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "math/helper_thread.hpp"
#include "runtime/options.hpp"
#include "solver/linear_solver.hpp"

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
  /// The condensed solve of contact takes as many nodes as it can hold, even if factors with contact cost less.
  bool condenses_all_contact = false;
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
  v.number(
      "work_budget", o.work_budget, "fast steps", {0, 1e6},
      "Work of a step, in fast steps of this hand (one evaluation, factorisation and solve). No iteration starts "
      "that would exceed the budget, except the first. 0: unlimited. `softhand-hand` then uses the work that its live "
      "steps do in 0.6 of its period. That is at least 1.5, or 4 with flexible objects.");
  v.number("chord_tolerance", o.chord_tolerance, "m", {0, 1e-2},
           "While nothing touches the hand, a step starts from the state predicted from velocities and reuses the "
           "factor of an earlier step. It ends when an iteration moves tissue and bones by no more than this (root "
           "mean square). None of them may move by more than seven times this. The remaining error is a fraction of "
           "this. 0: never.");
  v.flag("line_search", o.line_search,
         "Search along each iteration's direction, on the energy. Without it, a step can add energy to the scene, also "
         "with 60 iterations. Steps of one or two iterations throw gripped objects.");
  v.flag("measure_result", o.measure_result,
         "Evaluate energy and residual of the result. Without it, a fast step reports those of its start.");
  v.choice("curvature", o.curvature, {"adaptive", "projected", "exact"},
           "Hessian of the terms. 'projected' makes it positive semi-definite. 'exact' takes the Hessian of eq. 16 of "
           "the source, which may need a diagonal shift. 'adaptive' takes the exact Hessian of tissue, attachments and "
           "joints while the whole is positive definite. With a work budget, or with fewer than 3 iterations, "
           "'adaptive' is 'projected'.");
  v.choice("factor", o.factor, {"float", "double"},
           "Precision of the factor and of the products in the tissue's Hessian. With the curvature 'exact' these "
           "products are always double. Energy, gradient and residual are always double too, so float can only slow "
           "down convergence. If a float factor fails or makes no progress, the step uses double.");
}

/// With fewer iterations than this, a step cannot measure how well a reused factor contracts. Such a step takes plain
/// Newton iterations.
inline constexpr std::int64_t kFewIterations = 3;

/// Whether the Hessian of the terms without kinks is exact while the whole is positive definite. If it is not, the work
/// of its factor is lost. A work budget cannot afford this.
inline bool tries_exact(const SolverOptions& o) {
  return o.curvature == "adaptive" && o.max_iterations >= kFewIterations && o.work_budget == 0;
}

/// Throws std::invalid_argument if an option is out of range.
void check(const SolverOptions& options);

}  // namespace softhand
