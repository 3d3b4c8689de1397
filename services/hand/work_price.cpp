#include "hand/work_price.hpp"

#include <algorithm>

namespace softhand {
namespace {

// Fast steps. A step that makes a factor takes about as much, whatever its budget is. With a smaller budget no step
// converges with a reused factor. That costs less, but only if there is work left for a second iteration.
constexpr double kLeastBudget = 1.5;
// The same with flexible objects. Late steps that end after one iteration press a soft ball with up to eight times the
// force. A step that is late by more does less harm.
constexpr double kLeastSoftBudget = 4;
constexpr double kLargeStep = 0.5;  // in budgets
// The price rises after a step that cost more, and falls after one that cost less. The two rates are in balance if one
// of ten steps costs more. A single step that was interrupted for long counts no more than any other.
constexpr double kRise = 1.018, kFall = 0.998;

}  // namespace

double WorkPrice::least_budget(bool has_flexible_objects) {
  return has_flexible_objects ? kLeastSoftBudget : kLeastBudget;
}

WorkPrice::WorkPrice(double fast_step, double step_time, double least_budget)
    : step_time_(step_time), least_budget_(least_budget), fast_step_(std::min(fast_step, step_time / least_budget)) {}

void WorkPrice::learn(double seconds, double work) {
  if (!(work >= kLargeStep * budget())) return;
  fast_step_ *= seconds > fast_step_ * work ? kRise : kFall;
  fast_step_ = std::min(fast_step_, step_time_ / least_budget_);
}

}  // namespace softhand
