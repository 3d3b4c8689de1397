// Cases of two hands in one simulation.
#include <algorithm>

#include "scene/finger_gap.hpp"
#include "stress/cases.hpp"
#include "stress/hand_events.hpp"
#include "stress/watch.hpp"
#include "support/soft_bodies.hpp"
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

// The hands go through each other: 0.2 m at `speed`, and slowly back.
Findings through_each_other(double speed) {
  constexpr double kGap = 0.05, kWay = 0.2;  // m
  const int there = static_cast<int>(std::ceil(kWay / speed / kStep)) + kSecond / 2;
  return meet(kGap, there + 2 * kSecond, [=](int step) {
    return std::min(speed * kStep * step, kWay) - (kWay + 0.1) * std::clamp(step - there, 0, kSecond) / kSecond;
  });
}

// Both palms press a box from two sides. From 0.5 s on it has weight, along the palms, and settles between them.
Findings one_object(double mass) {
  constexpr double kPress = 0.012;  // m
  const Vector3 palm(0, 0, -0.06);  // its middle from the wrist, m
  double lowest = 0, of_palm = 0;   // skin of the hand, and of its palm, m
  for (const Vector3& node : shipped_hand().nodes) {
    lowest = std::min(lowest, node.y());
    if ((node - palm).cwiseProduct(Vector3(1, 0, 1)).norm() < 0.03) of_palm = std::min(of_palm, node.y());
  }
  const double gap = 0.01;  // m, between the half-closed fingers of both hands
  const Vector3 half(0.02, 0.5 * gap + of_palm - lowest, 0.03);
  const ShapeGeometry box(box_shape(half));
  testing::PalmToPalm hands(shipped_hand(), {}, gap, 1);
  HandSimulation& simulation = hands.simulation;
  simulation.enable_ledger(true);
  simulation.set_slot(0, {3, &box, mass, mass / box.solid().volume * box.solid().inertia, 0.8});
  simulation.set_slot_motion(0, {.position = palm}, {});
  HandWatch watch;
  Vector3 gripped = palm;
  for (int step = 0; step < 3 * kSecond; ++step) {
    const bool has_weight = step >= kSecond / 2;
    if (step == kSecond) gripped = simulation.slot_pose(0).position;
    hands.aim(std::min(1.0, 4.0 * step / kSecond) * kPress);
    simulation.make_dynamic(0, has_weight ? Vector3(testing::kGravity.y(), 0, 0) : Vector3(0, 0, 0));
    watch.after_step(simulation, simulation.step(kStep), kStep);
  }
  Findings findings;
  watch.judge(simulation, findings);
  findings.demand("held", "way of the box after the first second",
                  (simulation.slot_pose(0).position - gripped).norm() * 1e3, 5, "mm");
  findings.demand("G6", "speed of the box at the end", simulation.slot_velocity(0).linear.norm() * 1e3, 1, "mm/s");
  return findings;
}

}  // namespace

std::vector<Case> two_hands_cases() {
  CaseList cases("Two hands");
  auto* rows = &cases.add("two_hands", "both palms hold a box against its weight");
  for (const double mass : {0.001, 0.2, 1.0})
    rows->push_back({named("mass", mass, "kg"), [=] { return one_object(mass); }, {}, mass == 0.2});
  rows = &cases.add("hands_through", "the hands go through each other, and come apart without a bang");
  rows->push_back({"speed = 5 m/s", [] { return through_each_other(5); }});
  cases.add("hands_inside_at_start", "the hands come apart without a bang")
      .push_back({"8 mm", [] { return inside_at_the_start(); }, {}, true});
  return cases.take();
}

}  // namespace softhand::stress
