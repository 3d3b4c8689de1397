// A hand in the air: it reuses its factor, and its results stay the same.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "math/rotation.hpp"
#include "support/shapes.hpp"
#include "unit/hand_simulation_rig.hpp"

namespace softhand::idle_hand_test {
namespace {

using testing::cube_shape;
using testing::hand;
using testing::index;
using testing::kStep;
using testing::options;
using testing::set_rest_targets;

// A hand moves and touches nothing, with and without chord steps. Its fingers open and close, and its wrist moves and
// turns.
struct IdleRun {
  std::vector<Eigen::Matrix3Xd> nodes;
  std::vector<std::array<Vector3, kBodyCount>> coupling;
  int chord_steps = 0;
  int factorised_steps = 0;
  double tissue_evaluations = 0;  // per step
};

IdleRun move_freely(double chord_tolerance, double residual_tolerance) {
  SimulationOptions o = options();
  o.solver.max_iterations = 20;
  o.solver.chord_tolerance = chord_tolerance;
  o.solver.residual_tolerance = residual_tolerance;
  HandSimulation simulation(hand(), o, 1, 1);
  IdleRun run;
  for (int i = 1; i <= 180; ++i) {
    const double t = i * kStep;
    const double swell = std::min(1.0, t);
    const Pose wrist{swell * Vector3(0.08 * std::sin(3 * t), 0.05 * std::sin(2 * t), 0),
                     rotation_exp(swell * Vector3(0.3 * std::sin(2 * t), 0, 0.3 * std::sin(t)))};
    for (int b = 0; b < kBodyCount; ++b) {
      const Body body = static_cast<Body>(b);
      const Pose target = wrist * simulation.hand().rest_joints[index(joint_of(body))];
      const Vector3 flexion = b > 1 ? Vector3(-0.2 * swell * (1 - std::cos(3 * t)), 0, 0) : Vector3(Vector3::Zero());
      simulation.set_target(body, {target.position, target.orientation * rotation_exp(flexion)}, {});
    }
    const StepReport report = simulation.step(kStep);
    EXPECT_TRUE(report.state_changed);
    run.chord_steps += report.chord;
    run.factorised_steps += report.timing.factorisation > 0;
    run.nodes.push_back(simulation.state().node_positions);
    auto& coupling = run.coupling.emplace_back();
    for (std::size_t b = 0; b < kBodyCount; ++b) coupling[b] = simulation.coupling_wrench(static_cast<Body>(b)).force;
  }
  run.tissue_evaluations =
      static_cast<double>(simulation.work().tissue_elements / simulation.hand().tetrahedra.size()) / 180;
  return run;
}

TEST(HandSimulation, HandInTheAirReusesItsFactorWithTheSameResult) {
  const IdleRun exact = move_freely(0, 1e-9);
  const IdleRun idle = move_freely(SolverOptions{}.chord_tolerance, SolverOptions{}.residual_tolerance);
  ASSERT_EQ(exact.chord_steps, 0);
  ASSERT_GE((exact.nodes.back() - exact.nodes.front()).colwise().norm().minCoeff(), 0.002) << "the whole hand moved";
  EXPECT_EQ(idle.chord_steps, 180);
  EXPECT_LE(idle.factorised_steps, 180 / 4);
  EXPECT_LE(idle.tissue_evaluations, 2.5) << "one after each of two iterations, none at the start";
  double difference = 0, total = 0, worst_rms = 0;
  for (std::size_t i = 0; i < exact.nodes.size(); ++i) {
    worst_rms = std::max(
        worst_rms, (idle.nodes[i] - exact.nodes[i]).norm() / std::sqrt(static_cast<double>(exact.nodes[i].cols())));
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      difference += (idle.coupling[i][b] - exact.coupling[i][b]).squaredNorm();
      total += exact.coupling[i][b].squaredNorm();
    }
  }
  EXPECT_LE(worst_rms, 5e-5);
  EXPECT_LE(std::sqrt(difference / total), 0.01);
}

// Fingers that jump end far from where velocities predict them. Chord steps that fail there must cost little.
TEST(HandSimulation, FailedChordStepsCostLittle) {
  const auto work = [](double chord_tolerance) {
    SimulationOptions o = options();
    o.solver.max_iterations = 50;
    o.solver.chord_tolerance = chord_tolerance;
    HandSimulation simulation(hand(), o, 1, 0);
    double sum = 0;
    for (int i = 0; i < 80; ++i) {
      const double flexion = i / 3 % 2 == 0 ? 0.3 : 0.0;
      for (int b = 0; b < kBodyCount; ++b) {
        const auto body = static_cast<Body>(b);
        const Pose& rest = simulation.hand().rest_joints[index(joint_of(body))];
        const Vector3 turn(finger_of(body) == Finger::palm ? 0 : -flexion, 0, 0);
        simulation.set_target(body, {rest.position, rest.orientation * rotation_exp(turn)}, {});
      }
      sum += simulation.step(kStep).work;
    }
    return sum;
  };
  EXPECT_LE(work(SolverOptions{}.chord_tolerance), 1.1 * work(0));
}

// Chord steps keep the new budget too.
TEST(HandSimulation, ASmallerBudgetCutsStepsInTheAir) {
  SimulationOptions o = options();
  o.solver.work_budget = 8;
  HandSimulation changed(hand(), o, 1, 0);
  o.solver.work_budget = 0.3;
  HandSimulation small(hand(), o, 1, 0);
  changed.set_work_budget(0.3);
  for (int i = 0; i < 30; ++i) {
    for (HandSimulation* const simulation : {&changed, &small}) {
      set_rest_targets(*simulation, {Vector3(0.05 * std::sin(0.1 * i), 0, 0), Quaternion::Identity()});
      simulation->step(kStep);
    }
    ASSERT_EQ((changed.state().node_positions - small.state().node_positions).cwiseAbs().maxCoeff(), 0) << i;
  }
}

// `take_state` also takes over the factor, the forces and everything else that chord steps reuse.
TEST(HandSimulation, CopyInTheAirContinuesLikeTheOriginal) {
  HandSimulation one(hand(), options(), 1, 0), two(hand(), options(), 1, 0);
  const auto step = [](HandSimulation& simulation, int i) {
    set_rest_targets(simulation,
                     {Vector3(0.05 * std::sin(0.1 * i), 0, 0), rotation_exp(Vector3(0, 0.2 * std::sin(0.1 * i), 0))});
    const StepReport report = simulation.step(kStep);
    EXPECT_TRUE(report.chord) << i;
    return report.iterations;
  };
  for (int i = 0; i < 30; ++i) step(one, i);
  two.take_state(one);
  for (int i = 30; i < 40; ++i) {
    EXPECT_EQ(step(one, i), step(two, i)) << i;
    ASSERT_EQ((one.state().node_positions - two.state().node_positions).cwiseAbs().maxCoeff(), 0) << i;
  }
}

// A potential starts a step from the values that it stored at the end of the step before. So the ledger of a hand in
// the air costs no evaluation. The exceptions are the first step and a step after the nodes were moved from outside.
TEST(HandSimulation, LedgerOfAHandInTheAirCostsNoEvaluation) {
  HandSimulation without_ledger(hand(), options(), 1, 0), with_ledger(hand(), options(), 1, 0);
  with_ledger.enable_ledger(true);
  const auto evaluations = [](HandSimulation& simulation, int step) {
    const std::uint64_t before = simulation.work().tissue_elements;
    set_rest_targets(simulation, {Vector3(0.05 * std::sin(0.1 * step), 0, 0),
                                  rotation_exp(Vector3(0, 0.2 * std::sin(0.1 * step), 0))});
    EXPECT_TRUE(simulation.step(kStep).chord);
    return (simulation.work().tissue_elements - before) / simulation.hand().tetrahedra.size();
  };
  for (int i = 0; i < 60; ++i) {
    if (i == 30) {
      for (HandSimulation* simulation : {&without_ledger, &with_ledger}) {
        State stretched = simulation->state();
        stretched.node_positions *= 1.001;
        simulation->restore(stretched);
      }
      with_ledger.enable_ledger(false);
      with_ledger.enable_ledger(true);
    }
    EXPECT_EQ(evaluations(with_ledger, i), evaluations(without_ledger, i) + (i % 30 == 0 ? 1 : 0)) << i;
    if (i == 29) {
      EXPECT_LE(with_ledger.ledger().defect(), 1e-3);
    }
  }
  EXPECT_LE(with_ledger.ledger().defect(), 1e-3);
}

TEST(HandSimulation, StepWithContactIsNotAChordStep) {
  HandSimulation simulation(hand(), options(), 1, 0);
  const ShapeGeometry geometry(cube_shape(0.02));
  simulation.set_slot(0, {7, &geometry, 0.05, Matrix3::Identity() * 1.3e-5, 0.8});
  simulation.set_slot_motion(0, {Vector3(-0.012, -0.018 - 0.02 - 0.003, -0.092), Quaternion::Identity()}, {});
  int before = 0;
  for (int i = 0; i < 60; ++i) {
    set_rest_targets(simulation, {Vector3(0, -0.0003 * i, 0), Quaternion::Identity()});
    const StepReport report = simulation.step(kStep);
    ASSERT_EQ(report.chord, simulation.contact_count() == 0) << i;
    before += report.chord;
  }
  EXPECT_GT(before, 5);
  EXPECT_LT(before, 55) << "the hand must touch the cube";
}

}  // namespace
}  // namespace softhand::idle_hand_test
