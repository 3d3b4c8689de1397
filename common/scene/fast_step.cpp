#include "scene/fast_step.hpp"

#include <algorithm>
#include <stdexcept>
#include <vector>

#include "scene/hand_simulation.hpp"

namespace softhand {

double measure_fast_step(const HandModel& hand, const SimulationOptions& options, int mirrored_slots, int static_slots, int steps,
                         const std::function<double()>& clock) {
  if (steps < 1) throw std::invalid_argument("measure_fast_step: steps must be at least 1");
  constexpr double kStep = 1.0 / 90;  // s; the work does not depend on it
  SimulationOptions one_iteration = options;
  one_iteration.solver.max_iterations = 1;
  one_iteration.solver.chord_tolerance = 0;
  one_iteration.solver.keep_factor = false;
  one_iteration.solver.clock = clock;
  HandSimulation simulation(hand, one_iteration, mirrored_slots, static_slots);
  std::vector<double> seconds;
  // The first steps touch memory that was never used before.
  for (int i = -2; i < steps; ++i) {
    const StepReport report = simulation.step(kStep);
    if (i >= 0) seconds.push_back(report.timing.total() / report.work);
  }
  const auto middle = seconds.begin() + static_cast<std::ptrdiff_t>(seconds.size() / 2);
  std::nth_element(seconds.begin(), middle, seconds.end());
  return *middle;
}

}  // namespace softhand
