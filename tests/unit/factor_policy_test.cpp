// When a factor is reused.
#include "solver/factor_policy.hpp"

#include <gtest/gtest.h>

namespace softhand::factor_policy_test {
namespace {

// After two iterations with the last factor. The second one ended at `scale`.
FactorPolicy policy_after(double scale) {
  FactorPolicy policy({}, StepWork{.evaluation = 0.1, .linearisation = 0.3, .solve = 0.1, .whole_factor = 0.6});
  policy.begin_step(1.0 / 90, true, false);
  StepReport report;
  report.residual = 0.01;
  policy.learn({}, {.scale = 1, .move = 10, .residual_before = 0.1, .measured = true}, report);
  EXPECT_TRUE(policy.reuses());
  report.residual = 0.002;
  policy.learn({}, {.scale = scale, .move = 12, .residual_before = 0.01, .measured = true}, report);
  return policy;
}

TEST(FactorPolicy, AMoveBeyondTheFullStepDoesNotShowThatAFactorConvergesSlowly) {
  EXPECT_FALSE(policy_after(1).reuses()) << "the moves grow, so the factor does not converge";
  EXPECT_TRUE(policy_after(2.5).reuses()) << "the move is long because the step went on";
}

TEST(FactorPolicy, AMoveBeyondTheFullStepDoesNotMakeTheNextOneLookShort) {
  FactorPolicy policy = policy_after(2.5);
  StepReport report;
  report.residual = 0.0018;
  policy.learn({}, {.scale = 1, .move = 4, .residual_before = 0.002, .measured = true}, report);
  EXPECT_FALSE(policy.reuses()) << "the residual falls slowly";
}

}  // namespace
}  // namespace softhand::factor_policy_test
