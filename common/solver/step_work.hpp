// How much work the parts of a step are, in fast steps of the same scene: one evaluation with Hessian, one
// factorisation, one solve, and the evaluation of the line search. Real time is a budget of such work
// (`SolverOptions::work_budget`).
//
// A model with fixed constants, not a measurement: the same scene does the same work on every machine, to the bit. A
// process turns its period into work by timing a fast step once (services/hand/hand_size.hpp). How the constants were
// measured: docs/performance.md.
#pragma once

namespace softhand {

/// What decides the cost of a step's parts.
struct ScenePattern {
  double potential_blocks =
      0;  ///< stored blocks of the terms that depend on the state alone: tissue, attachments, joints
  double factor_operations = 0;  ///< floating-point operations of one factorisation
  double factor_entries = 0;     ///< stored numbers of the factor
};

/// In fast steps.
struct StepWork {
  double evaluation = 0;         ///< energy and gradient of all terms
  double linearisation = 0;      ///< energy, gradient and Hessian of all terms
  double frozen_evaluation = 0;  ///< energy and gradient where those of tissue, attachments and joints are known
  double contact_blocks = 0;     ///< writing the blocks of contact and friction anew
  double solve = 0;
  double per_operation = 0;        ///< of a float factorisation
  double whole_factor = 0;         ///< of a whole float factorisation
  double per_local_operation = 0;  ///< of the factorisations of `LocalNewton`
  double per_double = 0;           ///< a double factorisation over a float one
};

StepWork step_work(const ScenePattern& pattern);

}  // namespace softhand
