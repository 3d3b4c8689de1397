#include "solver/step_work.hpp"

#include <algorithm>

namespace softhand {
namespace {

// Relative times, in nanoseconds of the machine of docs/performance.md; only their ratios count.
constexpr double kEvaluation = 11;       // a potential block
constexpr double kLinearisation = 38;    // a potential block
constexpr double kFrozen = 0.15;         // of an evaluation
constexpr double kOperation = 0.018;     // a floating-point operation of the float factor
constexpr double kLocalOperation = 0.6;  // an operation of the factor of contact alone
constexpr double kEntry = 0.22;          // a number of the factor, in a solve
constexpr double kDouble = 1.8;

}  // namespace

StepWork step_work(const ScenePattern& pattern) {
  const double evaluation = kEvaluation * pattern.potential_blocks,
               linearisation = kLinearisation * pattern.potential_blocks;
  const double factor = kOperation * pattern.factor_operations, solve = kEntry * pattern.factor_entries;
  // A scene without tissue still has a step.
  const double unit = 1.0 / std::max(1.0, evaluation + linearisation + factor + solve);
  return {.evaluation = unit * evaluation,
          .linearisation = unit * linearisation,
          .frozen_evaluation = unit * kFrozen * evaluation,
          .contact_blocks = unit * kFrozen * evaluation,
          .solve = unit * solve,
          .per_operation = unit * kOperation,
          .whole_factor = unit * factor,
          .per_local_operation = unit * kLocalOperation,
          .per_double = kDouble};
}

}  // namespace softhand
