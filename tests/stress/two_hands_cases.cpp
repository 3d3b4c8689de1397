// Cases of two hands in one simulation.
#include <algorithm>

#include "scene/finger_gap.hpp"
#include "stress/cases.hpp"
#include "stress/hand_events.hpp"
#include "stress/watch.hpp"
#include "support/two_hands.hpp"

namespace softhand::stress {
namespace {

constexpr int kSecond = 90;  // steps

// Plays `closer_at(step)` m, by which the targets are nearer to each other than at the start.
template <typename CloserAt>
Findings meet(double gap, int steps, CloserAt&& closer_at) {
  testing::PalmToPalm hands(shipped_hand(), {}, gap);
  HandSimulation& simulation = hands.simulation;
  simulation.enable_ledger(true);
  HandWatch watch;
  watch.count_anchoring_as_work(true);  // of an overlap at the start
  double bones = 1, fastest = 0;        // m; m/s
  std::size_t touched = 0;
  for (int step = 0; step < steps; ++step) {
    hands.aim(closer_at(step));
    watch.after_step(simulation, simulation.step(kStep), kStep);
    touched = std::max(touched, simulation.skin_between()->anchors().size());
    bones = std::min(bones, hands_gap(simulation.hand(0), simulation.first_body(0), simulation.hand(1),
                                      simulation.first_body(1), simulation.state()));
    fastest = std::max(fastest, simulation.state().node_velocities.colwise().norm().maxCoeff());
  }
  Findings findings;
  watch.judge(simulation, findings);
  findings.demand_at_least("touch", "points of one hand that touch the other", static_cast<double>(touched), 1, "1");
  findings.demand_at_least("bones", "smallest gap between bones of both hands", bones * 1e3, 0, "mm");
  findings.demand("apart", "points that touch at the end",
                  static_cast<double>(simulation.skin_between()->anchors().size()), 0, "1");
  findings.demand("bang", "largest speed of the tissue", fastest, 10, "m/s");
  return findings;
}

// Part of the skin of each hand starts 8 mm inside the other. After half a second they move apart.
Findings inside_at_the_start() {
  constexpr int kHalf = kSecond / 2;
  return meet(-0.008, kSecond + kHalf / 2, [=](int step) { return -0.1 * std::clamp(step - kHalf, 0, kHalf) / kHalf; });
}

}  // namespace

std::vector<Case> two_hands_cases() {
  CaseList cases("Two hands");
  cases.add("hands_inside_at_start", "the hands come apart without a bang")
      .push_back({"8 mm", [] { return inside_at_the_start(); }, {}, true});
  return cases.take();
}

}  // namespace softhand::stress
