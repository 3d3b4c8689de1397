#include "hand/work_price.hpp"

#include <algorithm>

namespace softhand {
namespace {

// Fast steps. A step that makes a factor takes about as much, whatever its budget is. With a smaller budget no step
// converges with a reused factor. That costs less, but only if there is work left for a second iteration.
constexpr double kLeastBudget = 1.5;
constexpr double kLargeStep = 0.5;  // in budgets
// The price rises after a step that cost more, and falls after one that cost less. The two rates are in balance if one
// of ten steps costs more. A single step that was interrupted for long counts no more than any other.
constexpr double kRise = 1.018, kFall = 0.998;

}  // namespace

WorkPrice::WorkPrice(double fast_step, double step_time)
    : step_time_(step_time), fast_step_(std::min(fast_step, step_time / kLeastBudget)) {}

void WorkPrice::learn(double seconds, double work) {
  if (!(work >= kLargeStep * budget())) return;
  fast_step_ *= seconds > fast_step_ * work ? kRise : kFall;
  fast_step_ = std::min(fast_step_, step_time_ / kLeastBudget);
}

}  // namespace softhand
