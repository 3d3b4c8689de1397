#include "solver/step_report.hpp"

#include <cmath>

namespace softhand {

std::string_view to_string(StepStatus status) {
  constexpr std::array<std::string_view, 6> names{
      "converged", "iteration_limit", "budget_spent", "failed_factorisation", "nonfinite", "refused"};
  const auto index = static_cast<std::size_t>(status);
  return index < names.size() ? names[index] : "unknown";
}

double StepReport::rounding() const {
  double sum = 0;
  for (std::size_t t = 0; t < term_count; ++t) sum += std::abs(terms[t].joules);
  return 1e-14 * sum;
}

void StepMeter::restore(const StepReport& earlier) {
  const StepTiming timing = report.timing;
  const double work = report.work;
  report = earlier;
  report.timing = timing;
  report.work = work;
}

}  // namespace softhand
