#include "solver/step_work.hpp"

#include <algorithm>

namespace softhand {
namespace {

// Times in nanoseconds on the machine of docs/performance.md. Only their ratios matter.
constexpr double kEvaluation = 11;       // per potential block
constexpr double kLinearisation = 38;    // per potential block
constexpr double kFrozen = 0.15;         // fraction of an evaluation
constexpr double kOperation = 0.018;     // per floating-point operation of the float factorisation
constexpr double kLocalOperation = 0.6;  // per operation of the factorisation of contact alone
constexpr double kEntry = 0.22;          // per number of the factor, in a solve
constexpr double kDouble = 1.8;          // ratio of a double factorisation to a float factorisation

}  // namespace

StepWork step_work(const ScenePattern& pattern) {
  const double evaluation = kEvaluation * pattern.potential_blocks,
               linearisation = kLinearisation * pattern.potential_blocks;
  const double factor = kOperation * pattern.factor_operations, solve = kEntry * pattern.factor_entries;
  // A scene without tissue has a step too: avoid division by zero.
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
