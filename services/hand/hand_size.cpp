#include "hand/hand_size.hpp"

#include <algorithm>
#include <limits>

#include "geometry/shape.hpp"
#include "hand/work_price.hpp"
#include "scene/hand_simulation.hpp"

namespace softhand {
namespace {

constexpr double kLeastFastSteps = 2;  // rigid objects: a step that ends after less work is far from converged
constexpr int kWarmUp = 3, kSamples = 9, kFewest = 3;
// m. The sideways amplitude of the targets' motion: a hand at rest has nothing to solve. And how far the targets press
// the hand into the table.
constexpr double kTargetAmplitude = 2e-3, kTargetDepth = 4e-3;
constexpr double kFriction = 0.8;  // of the table
// Ratio of the time of the same work in a live step and here. A live step also writes messages and the flight recorder,
// and the other programs use the shared cache and the other thread of the core. Measured: docs/performance.md.
constexpr double kLivePrice = 2;
// Bytes that are written between two steps, so that a step finds its data in no cache of a core. In a rig other
// programs run between two steps.
constexpr std::size_t kCacheBytes = std::size_t{8} << 20;

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

double least_fast_steps(bool has_flexible_objects) {
  return std::max(kLeastFastSteps, WorkPrice::least_budget(has_flexible_objects));
}

HandSizeChoice choose_hand_size(std::size_t count, double budget, double least,
                                const std::function<double(std::size_t)>& measure) {
  HandSizeChoice choice;
  for (std::size_t size = 0; size < count; ++size) {
    const double fast_step = measure(size);
    choice.fast_steps.push_back(fast_step);
    const bool fits = budget >= least * fast_step;
    if (size == 0 || fits) {
      choice.size = size;
      choice.budget_fast_steps = budget / fast_step;
    }
    if (!fits) break;
  }
  return choice;
}

double measure_fast_step(const std::vector<HandModel>& hands, const HandOptions& options,
                         const std::vector<SoftObject>& soft_objects, double enough,
                         const std::function<double()>& clock) {
  SimulationOptions live = options.simulation;
  live.solver.chord_tolerance = 0;
  live.solver.work_budget = kLeastFastSteps;
  const int mirrored = static_cast<int>(options.mirrored_objects);
  HandSimulation simulation(hands, live, mirrored, std::max(1, static_cast<int>(options.static_objects)), {}, 0,
                            soft_objects);
  // Each hand presses on a table, because contact is expensive.
  Shape plane;
  plane.kind = static_cast<std::uint32_t>(ShapeKind::plane);
  const ShapeGeometry table(plane);
  double lowest = std::numeric_limits<double>::infinity();
  for (const Vector3& node : hands.front().nodes) lowest = std::min(lowest, node.y());
  const auto place = [](std::size_t h) { return Vector3(static_cast<double>(h), 0, 0); };
  for (std::size_t h = 1; h < hands.size(); ++h) {
    const Pose& wrist = hands[h].rest_joints[slot_of(Joint::wrist)];
    simulation.reposition({wrist.position + place(h), wrist.orientation}, static_cast<int>(h));
  }
  simulation.set_slot(mirrored, {.id = 1, .shape = &table, .friction = kFriction});
  simulation.set_slot_motion(mirrored, {Vector3(0, lowest, 0), Quaternion::Identity()}, {});
  std::vector<double> samples;
  std::vector<char> cache(kCacheBytes);
  for (int k = 0; k < kWarmUp + kSamples; ++k) {
    const Vector3 offset(k % 2 == 0 ? kTargetAmplitude : -kTargetAmplitude, -kTargetDepth, 0);
    for (std::size_t h = 0; h < hands.size(); ++h) {
      for (std::size_t b = 0; b < kBodyCount; ++b) {
        const Body body = static_cast<Body>(b);
        const Pose& rest = hands[h].rest_joints[slot_of(joint_of(body))];
        simulation.set_target(body, {rest.position + place(h) + offset, rest.orientation}, {}, 1, static_cast<int>(h));
      }
    }
    std::fill(cache.begin(), cache.end(), static_cast<char>(k));
    const double start = clock();
    const StepReport report = simulation.step(1 / options.rate_hz);
    const double seconds = clock() - start;
    if (k < kWarmUp) continue;
    samples.push_back(seconds / report.work);
    if (samples.size() >= kFewest && kLivePrice * *std::min_element(samples.begin(), samples.end()) > enough) break;
  }
  return kLivePrice * median(std::move(samples));
}

}  // namespace softhand
