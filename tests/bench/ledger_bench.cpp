// Measures the cost of the energy ledger. Two loops with the same input and state take their steps in turn, one with
// the ledger and one without. The output shows the thread's own time: medians of the steps and of the pairs' ratios.
// `taskset -c 1 bin/bench_ledger config/hands/right_1450.hand.json`.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "bench/measure.hpp"
#include "hand/hand_loop.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "model/hand_model.hpp"
#include "support/skeleton.hpp"
#include "tracking/tracking_loop.hpp"

namespace {
using namespace softhand;

Skeleton skeleton_of(const HandModel& hand, double seconds, std::uint64_t sequence) {
  const Pose wrist{Vector3(0.01 * std::sin(4 * seconds), -0.006 * std::sin(2 * seconds), 0),
                   rotation_exp(Vector3(0, 0.2 * std::sin(5 * seconds), 0))};
  return testing::skeleton_at(hand, wrist, static_cast<Nanoseconds>((1 + seconds) * 1e9), sequence);
}

// Calls `step(enabled, skeleton, now)` for both loops. Each loop comes first in half of the pairs.
template <typename Step>
void compare(const char* name, int pairs, double time_step, const HandModel& hand, Step&& step) {
  std::vector<double> spent[2], ratios;
  for (int i = 0; i < pairs; ++i) {
    const Skeleton skeleton = skeleton_of(hand, i * time_step, static_cast<std::uint64_t>(i) + 1);
    for (const int enabled : {i % 2, 1 - i % 2}) {
      spent[enabled].push_back(bench::seconds_of([&] { step(enabled == 1, skeleton, skeleton.stamp.sample_time); }));
    }
    ratios.push_back(spent[1].back() / spent[0].back());
  }
  std::printf("%-10s %10.2f us per step without ledger, %10.2f with ledger: %+.2f %%\n", name,
              1e6 * bench::median(spent[0]), 1e6 * bench::median(spent[1]), 100 * (bench::median(ratios) - 1));
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: bench_ledger HAND [PAIRS]\n");
    return 2;
  }
  const HandModel hand = load_hand(argv[1]);
  const int pairs = argc > 2 ? std::atoi(argv[2]) : 400;

  ObjectDescription box;
  box.object = 1;
  box.is_static = 1;
  box.friction = 0.8;
  box.shape.kind = static_cast<std::uint32_t>(ShapeKind::box);
  box.shape.size = {0.2, 0.02, 0.2};
  const Vector3 palm = hand.rest_joints[static_cast<std::size_t>(index_of(Joint::palm))].position;
  WorldObjects world;
  ObjectState state;
  state.object = 1;
  state.position = to_wire(Vector3(palm - Vector3(0, 0.036, 0)));
  world.objects.push_back(state);
  HandLoop with(hand, {}, {}), without(hand, {}, {});
  std::size_t touched = 0;
  for (HandLoop* loop : {&with, &without}) loop->describe_object(box);
  compare("hand", pairs, 1.0 / 90, hand, [&](bool enabled, const Skeleton& skeleton, Nanoseconds now) {
    world.stamp.sample_time = now;
    const HandOutput& output = (enabled ? with : without).step(now, {&skeleton, nullptr, &world}, {.ledger = enabled});
    touched += output.contacts.contacts.size();
  });
  std::printf("           %.0f contacts per step\n", static_cast<double>(touched) / (2.0 * pairs));

  TrackingLoop with_ledger({}, 90, hand, {}), without_ledger({}, 90, hand, {});
  compare("tracking", 50 * pairs, 1e-3, hand, [&](bool enabled, const Skeleton& skeleton, Nanoseconds now) {
    TrackingInput input;
    if (skeleton.stamp.sequence % 11 == 1) input.tracked = input.simulated = &skeleton;
    input.ledger_requested = enabled;
    (enabled ? with_ledger : without_ledger).step(now, input);
  });
  return 0;
}
