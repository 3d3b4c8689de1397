// The work of the parts of a step. The unit is a fast step of the same scene: one evaluation with Hessian, one
// factorisation, one solve, and the evaluation of the line search. Real time is a budget of such work
// (`SolverOptions::work_budget`).
//
// This is a model with fixed constants, not a measurement. So the same scene does the same work on every machine, to
// the bit. A process times a fast step once to convert its period into work (services/hand/hand_size.hpp). How the
// constants were measured: docs/performance.md.
#pragma once

namespace softhand {

/// The sizes that determine the cost of the parts of a step.
struct ScenePattern {
  /// Stored blocks of tissue, attachments and joints.
  double potential_blocks = 0;
  double factor_operations = 0;  ///< floating-point operations of one factorisation
  double factor_entries = 0;     ///< stored numbers of the factor
};

/// Work in fast steps.
struct StepWork {
  double evaluation = 0;         ///< energy and gradient of all terms
  double linearisation = 0;      ///< energy, gradient and Hessian of all terms
  double frozen_evaluation = 0;  ///< energy and gradient if those of tissue, attachments and joints are known
  double contact_blocks = 0;     ///< rewriting the blocks of contact and friction
  double solve = 0;
  double per_operation = 0;        ///< one operation of a float factorisation
  double whole_factor = 0;         ///< a whole float factorisation
  double per_local_operation = 0;  ///< one operation of the factorisations of `LocalNewton`
  double per_double = 0;           ///< ratio of a double factorisation to a float factorisation
};

StepWork step_work(const ScenePattern& pattern);

}  // namespace softhand
