// Solver cases: time steps, budgets, scenes far from the origin, masses, many steps, repetition.
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <thread>

#include "stress/cases.hpp"
#include "stress/grasp.hpp"
#include "stress/hand_events.hpp"
#include "support/box_mesh.hpp"

namespace softhand::stress {
namespace {

// Presses the hand on a block with steps of one length. The run is long enough to come to rest. It also has many steps,
// because the first long step cannot foresee the contact.
Findings time_step(double step) {
  Event event = pressed_on_block(4e-3);
  event.time_step = [step](int) { return step; };
  event.seconds = step < 1e-3 ? 0.35 : std::max(0.8, 100 * step);
  return run_touching(event, 0.5);
}

Findings alternating_time_step() {
  Event event = pressed_on_block(4e-3);
  event.time_step = [](int n) { return n % 2 == 0 ? kStep : 2 * kStep; };
  return run(event);
}

// Steps that must not change any bit of the state: a step of 0 s and a step whose length is not a valid time.
Findings no_step(double step, StepStatus expected) {
  HandSimulation simulation(shipped_hand(), {}, 1, 1);
  for (int b = 0; b < kBodyCount; ++b)
    simulation.set_target(static_cast<Body>(b), Pose{Vector3(0, 0.01, 0), Quaternion::Identity()}, {});
  for (int i = 0; i < 5; ++i) simulation.step(kStep);
  const State before = simulation.state();
  const StepReport report = simulation.step(step);
  const State& after = simulation.state();
  bool same = before.node_positions == after.node_positions && before.node_velocities == after.node_velocities;
  for (std::size_t b = 0; b < before.body_poses.size(); ++b) {
    same = same && before.body_poses[b].position == after.body_poses[b].position &&
           before.body_poses[b].orientation.coeffs() == after.body_poses[b].orientation.coeffs() &&
           before.body_velocities[b].linear == after.body_velocities[b].linear &&
           before.body_velocities[b].angular == after.body_velocities[b].angular;
  }
  Findings findings;
  findings.demand("G1", "numbers that are not finite", softhand::all_finite(after) ? 0 : 1, 0, "1", Class::diverged);
  findings.demand("bitwise no-op", "states that changed", same ? 0 : 1, 0, "1");
  findings.demand("status", "steps with another status than " + std::string(to_string(expected)),
                  report.status == expected ? 0 : 1, 0, "1");
  return findings;
}

Findings no_time(double step) {
  Findings findings = no_step(step, StepStatus::refused);
  findings.refusal = "HandSimulation::step reports the status `refused`";
  findings.refusal_is_right = true;
  return findings;
}

Findings with_solver(const std::vector<std::string>& overrides, bool must_flag) {
  Grasp setting;
  setting.overrides = overrides;
  Grasped result = grasp(setting);
  if (must_flag)
    result.findings.demand_at_least("flagged", "steps reported as not converged",
                                    static_cast<double>(result.unconverged), 1, "1");
  return result.findings;
}

// The whole scene, moved to `place`.
Findings at(const Vector3& place) {
  const auto vector = [&place](double x, double y, double z) {
    return fmt::format("[{},{},{}]", place.x() + x, place.y() + y, place.z() + z);
  };
  Grasp setting;
  setting.overrides = {"objects.table.position=" + vector(0, -0.02, 0), "objects.cube.position=" + vector(0, 0.02, 0),
                       "generator.object_position=" + vector(0, 0.026, 0)};
  return grasp_findings(setting);
}

// An object between the hand and a table. Its mass is `ratio` times the mass of a mean tissue node (0.6 g).
Findings mass_ratio(double ratio) {
  const HandModel& hand = shipped_hand();
  const std::vector<double> masses = lumped_masses(hand);
  const double tissue = std::accumulate(masses.begin(), masses.end(), 0.0);
  Event event = pressed_on_block(4e-3);
  event.object.mass = ratio * tissue / hand.node_count();
  event.object.on_table = true;
  double sunk = 0;
  const double start = event.object.pose.position.y();
  Findings findings =
      run(event, [&](const EventStep& now) { sunk = start - now.simulation.slot_pose(now.slot).position.y(); });
  findings.demand("rests", "distance that the object sinks into the table", std::abs(sunk) * 1e3, 1, "mm");
  return findings;
}

// Presses a finger on a block and holds it for `steps` steps. The resting state must neither drift nor grow.
Findings many_steps(int steps) {
  constexpr double kSettle = 3;  // s
  Event event;
  event.hand = one_finger(shipped_hand(), Finger::index);
  const Vector3 pad = pad_of(event.hand, Finger::index);
  event.object.shape = box_shape({0.05, 0.02, 0.05});
  event.object.pose.position = pad - Vector3(0, 0.022, 0);
  event.bones = press_down(4e-3, 0.3);
  event.seconds = steps * kStep;
  Eigen::Matrix3Xd settled;
  double settled_energy = 0, energy = 0, drift = 0;
  int taken = 0;
  Findings findings = run(event, [&](const EventStep& now) {
    ++taken;
    energy = now.report.energy;
    if (settled.cols() == 0 && now.time >= kSettle)
      settled = now.simulation.state().node_positions, settled_energy = energy;
    if (settled.cols() > 0)
      drift = (now.simulation.state().node_positions - settled).colwise().norm().maxCoeff() /
              std::max(now.time - kSettle, 1.0);
  });
  findings.demand("no growth", "energy over the energy after 3 s, minus one", energy / settled_energy - 1, 1e-6, "1");
  findings.demand("G6", "drift of the tissue after 3 s", drift * 1e6, 1, "um/s");
  return findings;
}

Findings repeated(bool at_once) {
  Grasp setting;
  setting.seconds = 1;
  setting.held = false;
  std::array<Grasped, 2> results;
  if (at_once) {
    Grasp first = setting;
    first.seconds = 0.05;
    grasp(first);  // fills the caches of results that are computed once
    std::thread other([&] { results[1] = grasp(setting); });
    results[0] = grasp(setting);
    other.join();
  } else {
    for (Grasped& result : results) result = grasp(setting);
  }
  Findings findings = results[0].findings;
  findings.demand("same bits", "runs whose states differ", results[0].hash == results[1].hash ? 0 : 1, 0, "1");
  return findings;
}

}  // namespace

std::vector<Case> solver_cases() {
  CaseList cases("Solver");
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();

  auto* rows = &cases.add("time_step", "the hand pressed 4 mm on a block");
  for (const double step : {1e-4, 1e-3, 1.0 / 240, 1.0 / 90, 1.0 / 30, 0.1, 1.0})
    rows->push_back({named("dt", step, "s"), [step] { return time_step(step); }, {}, step == 0.1});
  rows->push_back({"dt = 1/90 s, 1/45 s in turn", [] { return alternating_time_step(); }, {}, true});
  rows = &cases.add("no_time_step", "a step of 0 s changes no bit, a length that is not a valid time is refused");
  rows->push_back({"dt = 0 s", [] { return no_step(0, StepStatus::converged); }, {}, true});
  for (const double step : {-kStep, nan, infinity})
    rows->push_back({named("dt", step, "s"), [step] { return no_time(step); }, {}, true});
  rows = &cases.add("solver_budget", "the cube is lifted and held, and steps that do not converge report this");
  for (const int iterations : {1, 2, 3}) {
    rows->push_back({fmt::format("max_iterations = {}", iterations),
                     [iterations] {
                       return with_solver({fmt::format("hand.simulation.solver.max_iterations={}", iterations)}, true);
                     },
                     {},
                     false,
                     false,
                     fmt::format("{} steps", iterations)});
  }
  for (const double budget : {1.0, kLiveBudget}) {
    rows->push_back(
        {named("work_budget", budget),
         [budget] { return with_solver({fmt::format("hand.simulation.solver.work_budget={:g}", budget)}, true); },
         {},
         budget == kLiveBudget,
         false,
         "live budget"});
  }
  rows->push_back({"work_budget = 0.001",
                   [] { return with_solver({"hand.simulation.solver.work_budget=0.001"}, true); },
                   {},
                   true});
  rows = &cases.add("far_from_origin", "the cube is lifted and held");
  for (const double distance : {0.0, 10.0, 1000.0}) {
    rows->push_back({named("distance", distance, "m"),
                     [distance] { return at(distance / std::sqrt(3.0) * Vector3::Ones()); },
                     {},
                     distance == 10});
  }
  rows = &cases.add("mass_ratio", "mass of an object between hand and table, over the mass of a mean node");
  for (const double ratio : {1e-4, 1e-2, 1.0, 1e2, 1e4, 1e6})
    rows->push_back({named("ratio", ratio), [ratio] { return mass_ratio(ratio); }, {}, ratio == 1e6});
  rows = &cases.add("many_steps", "one finger held on a block: no growth, no drift");
  rows->push_back({"10 000 steps", [] { return many_steps(10'000); }});
  rows->push_back({"1 000 000 steps", [] { return many_steps(1'000'000); }});
  rows = &cases.add("repetition", "every bit of every loop is the same in both runs");
  rows->push_back({"twice", [] { return repeated(false); }, {}, true});
  rows->push_back({"two at once in threads", [] { return repeated(true); }});
  return cases.take();
}

}  // namespace softhand::stress
