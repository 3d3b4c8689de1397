#include "hand/hand_size.hpp"

#include <algorithm>

#include "scene/hand_simulation.hpp"

namespace softhand {
namespace {

constexpr double kLeastFastSteps = 2;  // a step that ends after less work is far from converged
constexpr int kWarmUp = 2, kSamples = 9, kFewest = 3;
constexpr double kTargetAmplitude =
    2e-3;  // m, amplitude of the targets' motion; without motion there would be nothing to solve

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

HandSizeChoice choose_hand_size(std::size_t count, double budget, const std::function<double(std::size_t)>& measure) {
  HandSizeChoice choice;
  for (std::size_t size = 0; size < count; ++size) {
    const double fast_step = measure(size);
    choice.fast_steps.push_back(fast_step);
    const bool fits = budget >= kLeastFastSteps * fast_step;
    if (size == 0 || fits) {
      choice.size = size;
      choice.budget_fast_steps = budget / fast_step;
    }
    if (!fits) break;
  }
  return choice;
}

double measure_fast_step(const HandModel& hand, const HandOptions& options, const std::vector<SoftObject>& soft_objects,
                         double enough, const std::function<double()>& clock) {
  SimulationOptions fast = options.simulation;
  fast.solver.max_iterations = 1;
  fast.solver.keep_factor = false;
  fast.solver.chord_tolerance = 0;
  fast.solver.measure_result = false;
  fast.solver.work_budget = 0;
  HandSimulation simulation(hand, fast, static_cast<int>(options.mirrored_objects),
                            static_cast<int>(options.static_objects), {}, 0, soft_objects);
  std::vector<double> samples;
  for (int k = 0; k < kWarmUp + kSamples; ++k) {
    const Vector3 offset(k % 2 == 0 ? kTargetAmplitude : -kTargetAmplitude, 0, 0);
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const Body body = static_cast<Body>(b);
      const Pose& rest = hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(body)))];
      simulation.set_target(body, {rest.position + offset, rest.orientation}, {});
    }
    const double start = clock();
    simulation.step(1 / options.rate_hz);
    if (k < kWarmUp) continue;
    samples.push_back(clock() - start);
    if (samples.size() >= kFewest && *std::min_element(samples.begin(), samples.end()) > enough) break;
  }
  return median(std::move(samples));
}

}  // namespace softhand
