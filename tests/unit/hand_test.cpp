#include <gtest/gtest.h>

#include <limits>
#include <utility>

#include "hand/hand_loop.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "support/block_hand.hpp"
#include "support/box_mesh.hpp"
#include "support/cores.hpp"
#include "support/count_allocations.hpp"

namespace softhand {
namespace {

using testing::block_hand;

constexpr Nanoseconds kSecond = 1'000'000'000;
constexpr double kStep = 1.0 / 90;

std::size_t index(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }

// A hand whose tissue is attached well enough to follow its bones.
HandModel hand() { return block_hand(1); }

SimulationOptions options() {
  SimulationOptions o;
  o.solver.max_iterations = 4;
  return o;
}

void set_rest_targets(HandSimulation& simulation, const Pose& wrist) {
  for (int b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    simulation.set_target(body, wrist * simulation.hand().rest_joints[index(joint_of(body))], {});
  }
}

double worst_joint_error(const HandSimulation& simulation, const Pose& wrist) {
  double worst = 0;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    worst = std::max(worst, (simulation.joint_pose(static_cast<Joint>(j)).position - wrist * simulation.hand().rest_joints[j].position).norm());
  }
  return worst;
}

TEST(HandSimulation, RestIsStationary) {
  HandSimulation simulation(hand(), options(), 1, 1);
  set_rest_targets(simulation, {});
  const State before = simulation.state();
  for (int i = 0; i < 20; ++i) ASSERT_TRUE(simulation.step(kStep).state_changed);
  EXPECT_LE((simulation.state().node_positions - before.node_positions).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(HandSimulation, FollowsItsTargetsAndTurnsWithThem) {
  HandSimulation simulation(hand(), options(), 0, 0);
  const Pose wrist{Vector3(0.03, 0.02, -0.04), rotation_exp(Vector3(0.1, 0.2, -0.1))};
  set_rest_targets(simulation, wrist);
  for (int i = 0; i < 90; ++i) simulation.step(kStep);
  EXPECT_LE(worst_joint_error(simulation, wrist), 1e-4);
  EXPECT_EQ(simulation.inverted_elements(), 0);
}

TEST(HandSimulation, RepositioningMovesAllRigidly) {
  HandSimulation simulation(hand(), options(), 0, 0);
  const Pose wrist{Vector3(10, -3, 2), rotation_exp(Vector3(0, 2, 1))};
  simulation.reposition(wrist);
  set_rest_targets(simulation, wrist);
  EXPECT_LE(worst_joint_error(simulation, wrist), 1e-12);
  for (int i = 0; i < 10; ++i) simulation.step(kStep);
  EXPECT_LE(worst_joint_error(simulation, wrist), 1e-8);
}

TEST(HandSimulation, GoesOnFromAKeptState) {
  HandSimulation simulation(hand(), options(), 0, 0);
  set_rest_targets(simulation, {Vector3(0.03, 0, 0), Quaternion::Identity()});
  for (int i = 0; i < 5; ++i) simulation.step(kStep);
  const State kept = simulation.state();
  simulation.step(kStep);
  const Eigen::Matrix3Xd once = simulation.state().node_positions;
  simulation.restore(kept);
  simulation.step(kStep);
  EXPECT_EQ(simulation.state().node_positions, once);
  State other = kept;
  other.body_poses.pop_back();
  EXPECT_THROW(simulation.restore(other), std::invalid_argument);
}

TEST(HandSimulation, TissueThatStaysInsideOutIsPutBack) {
  // Every node somewhere in the hand's box: the tissue's energy has many minima with inverted tetrahedra.
  const auto inverted_after = [](double patience, std::uint64_t& untangled) {
    SimulationOptions o = options();
    o.untangle_patience = patience;
    HandSimulation simulation(hand(), o, 0, 0);
    set_rest_targets(simulation, {});
    State state = simulation.state();
    const Vector3 low = state.node_positions.rowwise().minCoeff(), high = state.node_positions.rowwise().maxCoeff();
    testing::Random random(1);
    for (Eigen::Index n = 0; n < state.node_positions.cols(); ++n) {
      state.node_positions.col(n) = 0.5 * (low + high) + 0.5 * (high - low).cwiseProduct(random.vector());
    }
    simulation.restore(state);
    for (int i = 0; i < 180; ++i) simulation.step(kStep);
    untangled = simulation.untangled_nodes();
    return simulation.inverted_elements();
  };
  std::uint64_t untangled = 0;
  EXPECT_GT(inverted_after(0, untangled), 0) << "it came back by itself: this shows nothing";
  EXPECT_EQ(untangled, 0u);
  EXPECT_EQ(inverted_after(SimulationOptions{}.untangle_patience, untangled), 0);
  EXPECT_GT(untangled, 0u);
}

TEST(HandSimulation, TissueThatStaysTwistedIsPutBack) {
  // Collapsed to a line it is wound about its bones when it comes out again, and none of it is inside out.
  const HandModel shipped = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  const auto distance_after = [&shipped](double patience, std::uint64_t& untangled) {
    SimulationOptions o;
    o.untangle_patience = patience;
    HandSimulation simulation(shipped, o, 0, 0);
    for (int b = 0; b < kBodyCount; ++b) simulation.set_target(static_cast<Body>(b), shipped.rest_joints[index(joint_of(static_cast<Body>(b)))], {});
    const State rest = simulation.state();
    State state = rest;
    const Vector3 middle = state.node_positions.rowwise().mean();
    testing::Random random(7);
    for (Eigen::Index n = 0; n < state.node_positions.cols(); ++n) {
      state.node_positions.col(n) = middle + Vector3(0, 0, state.node_positions(2, n) - middle.z()) + 1e-12 * random.vector();
    }
    simulation.restore(state);
    for (int i = 0; i < 200; ++i) simulation.step(kStep);
    untangled = simulation.untangled_nodes();
    return std::sqrt((simulation.state().node_positions - rest.node_positions).squaredNorm() / shipped.node_count());
  };
  std::uint64_t untangled = 0;
  EXPECT_GT(distance_after(0, untangled), 1e-3) << "it came back by itself: this shows nothing";
  EXPECT_EQ(untangled, 0u);
  EXPECT_LT(distance_after(SimulationOptions{}.untangle_patience, untangled), 1e-4);
  EXPECT_GT(untangled, 0u);
}

TEST(HandSimulation, NoSlotsNoObjectTerms) {
  HandSimulation simulation(hand(), options(), 0, 0);
  set_rest_targets(simulation, {});
  const StepReport report = simulation.step(kStep);
  for (std::size_t t = 0; t < report.term_count; ++t) {
    EXPECT_NE(report.terms[t].name, "contact");
    EXPECT_NE(report.terms[t].name, "friction");
    EXPECT_NE(report.terms[t].name, "plane_contact");
  }
}

TEST(HandSimulation, BonesAloneDoNoWorkOnTissue) {
  HandModel bones = hand();
  bones.nodes.clear();
  bones.node_body.clear();
  bones.tetrahedra.clear();
  bones.tetrahedron_material.clear();
  bones.attachments.clear();
  bones.surface.clear();
  HandSimulation simulation(bones, options(), 0, 0);
  const Pose wrist{Vector3(0.03, 0.02, -0.04), rotation_exp(Vector3(0.1, 0.2, -0.1))};
  set_rest_targets(simulation, wrist);
  for (int i = 0; i < 90; ++i) ASSERT_TRUE(simulation.step(kStep).state_changed);
  EXPECT_LE(worst_joint_error(simulation, wrist), 1e-4) << "the bones move all the same";
  EXPECT_EQ(simulation.work().tissue_elements, 0u);
  EXPECT_EQ(simulation.work().contact_queries, 0u);
}

TEST(HandSimulation, ContactIsSoughtOnlyNearObjects) {
  HandSimulation simulation(hand(), options(), 1, 1);
  set_rest_targets(simulation, {});
  for (int i = 0; i < 5; ++i) simulation.step(kStep);
  EXPECT_GT(simulation.work().tissue_elements, 0u);
  EXPECT_EQ(simulation.work().contact_queries, 0u) << "both slots are empty";
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(ShapeKind::sphere);
  shape.size = {0.02, 0, 0};
  const ShapeGeometry geometry(shape);
  simulation.set_slot(0, {7, &geometry, 0.05, Matrix3::Identity() * 1.3e-5, 0.8});
  simulation.set_slot_motion(0, {Vector3(0, 0.5, 0), Quaternion::Identity()}, {});
  for (int i = 0; i < 5; ++i) simulation.step(kStep);
  EXPECT_EQ(simulation.work().contact_queries, 0u) << "the object is half a metre off";
  simulation.set_slot_motion(0, {Vector3(-0.02, 0.045, -0.16), Quaternion::Identity()}, {});
  simulation.step(kStep);
  const std::uint64_t near = simulation.work().contact_queries;
  EXPECT_GT(near, 0u);
  EXPECT_LT(near, 2u * static_cast<std::uint64_t>(simulation.hand().node_count())) << "of the bones nearby";
}

Shape box(double half) {
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(ShapeKind::box);
  shape.size = {half, half, half};
  return shape;
}

TEST(HandSimulation, ADynamicSlotFallsAndAKinematicOneStays) {
  SimulationOptions exact = options();
  exact.solver.factor = "double";
  HandSimulation simulation(hand(), exact, 2, 0);
  set_rest_targets(simulation, {});
  const ShapeGeometry geometry(box(0.02));
  const MirroredObject object{7, &geometry, 0.05, Matrix3::Identity() * 1.3e-5, 0.8};
  for (int slot = 0; slot < 2; ++slot) {
    simulation.set_slot(slot, object);
    simulation.set_slot_motion(slot, {Vector3(3 + slot, 1, 0), Quaternion::Identity()}, {});
  }
  simulation.make_dynamic(0, Vector3(0, -9.81, 0));
  const int steps = 45;
  for (int i = 0; i < steps; ++i) simulation.step(kStep);
  // Backward Euler falls g dt^2 n (n + 1) / 2.
  EXPECT_NEAR(simulation.slot_pose(0).position.y(), 1 - 9.81 * kStep * kStep * steps * (steps + 1) / 2, 1e-9);
  EXPECT_EQ(simulation.slot_pose(1).position.y(), 1);
}

TEST(HandSimulation, HoldsAnObjectThatItIsPressedOn) {
  // The palm's underside is pressed on a box from above: the box's weight and the hand's push end in one contact force.
  HandSimulation simulation(hand(), options(), 1, 0);
  const ShapeGeometry geometry(box(0.02));
  simulation.set_slot(0, {7, &geometry, 0.05, Matrix3::Identity() * 1.3e-5, 0.8});
  simulation.set_slot_motion(0, {Vector3(-0.012, -0.018 - 0.02 - 0.001, -0.092), Quaternion::Identity()}, {});
  const Pose pressed{Vector3(0, -0.004, 0), Quaternion::Identity()};
  set_rest_targets(simulation, pressed);
  for (int i = 0; i < 90; ++i) simulation.step(kStep);
  ASSERT_TRUE(simulation.touched(0));
  const Wrench wrench = simulation.contact_wrench(0);
  EXPECT_LT(wrench.force.y(), -0.5);
  Vector3 coupling = Vector3::Zero();
  for (int b = 0; b < kBodyCount; ++b) coupling += simulation.coupling_wrench(static_cast<Body>(b)).force;
  EXPECT_NEAR(coupling.y(), wrench.force.y(), 0.02) << "what the couplings press with reaches the object";
}

// A factor that is carried from step to step ends where a new one does: within what VALIDATION.md allows to what is left out.
TEST(HandSimulation, HoldsAnObjectAsWellWithTheFactorOfTheStepBefore) {
  SimulationOptions carrying = options(), exact = options();
  exact.solver.carry_factor = false;
  exact.solver.residual_tolerance = 1e-9;
  exact.solver.factor = "double";
  HandSimulation quick(hand(), carrying, 1, 0), slow(hand(), exact, 1, 0);
  const ShapeGeometry geometry(box(0.02));
  for (HandSimulation* simulation : {&quick, &slow}) {
    simulation->set_slot(0, {7, &geometry, 0.05, Matrix3::Identity() * 1.3e-5, 0.8});
    simulation->set_slot_motion(0, {Vector3(-0.012, -0.018 - 0.02 - 0.001, -0.092), Quaternion::Identity()}, {});
  }
  int carried = 0;
  for (int i = 0; i < 120; ++i) {
    const Pose pressed{Vector3(2e-4 * std::sin(0.3 * i), -0.004, 0), Quaternion::Identity()};
    set_rest_targets(quick, pressed);
    set_rest_targets(slow, pressed);
    const StepReport report = quick.step(kStep);
    slow.step(kStep);
    if (quick.touched(0)) carried += report.factorisations == 0;
    ASSERT_LE((quick.state().node_positions - slow.state().node_positions).norm() / std::sqrt(static_cast<double>(hand().node_count())), 5e-5) << i;
    if (i > 30) {
      ASSERT_LE((quick.contact_wrench(0).force - slow.contact_wrench(0).force).norm(), 0.01 * slow.contact_wrench(0).force.norm()) << i;
    }
  }
  EXPECT_GE(carried, 60);
}

TEST(HandSimulation, TwoThreadsGiveTheBitsOfOne) {
  if (testing::allowed_cores() < 2) GTEST_SKIP() << "one core";
  ASSERT_TRUE(HelperThread().present());
  SimulationOptions two = options();
  two.threads = 2;
  HandSimulation alone(hand(), options(), 1, 0), shared(hand(), two, 1, 0);
  const ShapeGeometry geometry(box(0.02));
  for (HandSimulation* simulation : {&alone, &shared}) {
    simulation->set_slot(0, {7, &geometry, 0.05, Matrix3::Identity() * 1.3e-5, 0.8});
    simulation->set_slot_motion(0, {Vector3(-0.012, -0.018 - 0.02 - 0.001, -0.092), Quaternion::Identity()}, {});
    set_rest_targets(*simulation, {Vector3(0, -0.004, 0), Quaternion::Identity()});
  }
  for (int i = 0; i < 60; ++i) {
    alone.step(kStep);
    shared.step(kStep);
    ASSERT_EQ(shared.state().node_positions, alone.state().node_positions) << i;
    ASSERT_EQ(shared.state().node_velocities, alone.state().node_velocities) << i;
  }
  EXPECT_TRUE(alone.touched(0)) << "half of this is about contact";
}

// A hand that comes down on a box, drags it, lets the world have it, is put elsewhere and comes back.
TEST(HandSimulation, TheEnergyLedgerCloses) {
  SimulationOptions exact = options();
  exact.solver.max_iterations = 30;
  exact.solver.residual_tolerance = 1e-8;
  exact.solver.chord_tolerance = 0;
  HandSimulation simulation(hand(), exact, 1, 0);
  simulation.keep_ledger(true);
  const ShapeGeometry geometry(box(0.02));
  simulation.set_slot(0, {7, &geometry, 0.05, Matrix3::Identity() * 1.3e-5, 0.8});
  simulation.set_slot_motion(0, {Vector3(-0.012, -0.018 - 0.02 - 0.001, -0.092), Quaternion::Identity()}, {});
  NeighbourPlane floor;
  floor.point = {0, -0.059, 0};
  floor.normal = {0, 1, 0};
  floor.friction = 0.3;
  int touched = 0, owned = 0;
  for (int i = 0; i < 240; ++i) {
    const double t = i * kStep;
    if (i == 160) simulation.reposition({Vector3(0, 0.3, 0), Quaternion::Identity()});
    if (i == 120) simulation.make_kinematic(0);
    const Pose wrist{Vector3(0.01 * std::sin(4 * t), i < 160 ? -0.005 * std::min(1.0, 3 * t) : 0.3 - 0.1 * (t - 160 * kStep), 0),
                     rotation_exp(Vector3(0, 0.1 * std::sin(3 * t), 0))};
    set_rest_targets(simulation, wrist);
    if (i >= 20 && i < 120 && simulation.touched(0)) {
      simulation.make_dynamic(0, Vector3(0, -9.81, 0));
      simulation.set_planes(0, {&floor, 1});
      ++owned;
    }
    ASSERT_TRUE(simulation.step(kStep).state_changed);
    touched += simulation.touched(0) ? 1 : 0;
  }
  ASSERT_GT(touched, 100);
  ASSERT_GT(owned, 60);
  const EnergyLedger& ledger = simulation.ledger();
  EXPECT_GT(ledger.total().friction, 0);
  EXPECT_GT(ledger.total().damping, 0);
  EXPECT_LE(ledger.defect(), 1e-4);
  EXPECT_LE(ledger.excess(), 0.01);
  simulation.keep_ledger(false);
  simulation.keep_ledger(true);
  EXPECT_FALSE(ledger.begun());
}

// A hand that moves and touches nothing, with and without chord steps: fingers open and close by what `bend` says, the wrist goes round.
struct IdleRun {
  std::vector<Eigen::Matrix3Xd> nodes;
  std::vector<std::array<Vector3, kBodyCount>> coupling;
  int chord_steps = 0;
  int factorised_steps = 0;
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
    const Pose wrist{swell * Vector3(0.08 * std::sin(3 * t), 0.05 * std::sin(2 * t), 0), rotation_exp(swell * Vector3(0.3 * std::sin(2 * t), 0, 0.3 * std::sin(t)))};
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
  return run;
}

TEST(HandSimulation, AHandThatTouchesNothingKeepsItsFactorAndItsResult) {
  const IdleRun exact = move_freely(0, 1e-9);
  const IdleRun idle = move_freely(SolverOptions{}.chord_tolerance, SolverOptions{}.residual_tolerance);
  ASSERT_EQ(exact.chord_steps, 0);
  ASSERT_GE((exact.nodes.back() - exact.nodes.front()).colwise().norm().minCoeff(), 0.002) << "the whole hand moved";
  EXPECT_EQ(idle.chord_steps, 180);
  EXPECT_LE(idle.factorised_steps, 180 / 4);
  double difference = 0, total = 0, worst_rms = 0;
  for (std::size_t i = 0; i < exact.nodes.size(); ++i) {
    worst_rms = std::max(worst_rms, (idle.nodes[i] - exact.nodes[i]).norm() / std::sqrt(static_cast<double>(exact.nodes[i].cols())));
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      difference += (idle.coupling[i][b] - exact.coupling[i][b]).squaredNorm();
      total += exact.coupling[i][b].squaredNorm();
    }
  }
  EXPECT_LE(worst_rms, 5e-5);
  EXPECT_LE(std::sqrt(difference / total), 0.01);
}

TEST(HandSimulation, TheStepThatTouchesIsNoChordStep) {
  HandSimulation simulation(hand(), options(), 1, 0);
  const ShapeGeometry geometry(box(0.02));
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
  EXPECT_LT(before, 55) << "it did touch";
}

// --- the loop ---

Skeleton skeleton_at(const HandModel& model, const Pose& wrist, Nanoseconds time, std::uint64_t sequence) {
  Skeleton skeleton;
  skeleton.stamp.sequence = sequence;
  skeleton.stamp.sample_time = time;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Pose pose = wrist * model.rest_joints[j];
    skeleton.joints[j].position = to_wire(pose.position);
    skeleton.joints[j].orientation = to_wire(pose.orientation);
    skeleton.joints[j].flags = kJointValid | kJointTracked;
  }
  return skeleton;
}

HandOptions loop_options() {
  HandOptions o;
  o.simulation = options();
  o.mirrored_objects = 1;
  o.static_objects = 0;
  return o;
}

TEST(HandLoop, ComesToItsFirstSkeletonAtOnceAndFollows) {
  HandLoop loop(hand(), loop_options(), {});
  const Pose wrist{Vector3(1, 1.2, -0.5), Quaternion::Identity()};
  const Skeleton first = skeleton_at(hand(), wrist, kSecond, 1);
  const HandOutput& output = loop.step(kSecond, {&first}, {});
  EXPECT_LE((to_vector(output.simulated.joints[index(Joint::index_tip)].position) - wrist * hand().rest_joints[index(Joint::index_tip)].position).norm(), 1e-3);
  EXPECT_EQ(loop.counters().repositioned, 0u);
}

TEST(HandLoop, AJumpRepositionsAndIsCounted) {
  HandLoop loop(hand(), loop_options(), {});
  const Skeleton first = skeleton_at(hand(), {}, kSecond, 1);
  loop.step(kSecond, {&first}, {});
  const Pose far{Vector3(10, 0, 0), Quaternion::Identity()};
  const Skeleton jump = skeleton_at(hand(), far, kSecond + 11'000'000, 2);
  const HandOutput& output = loop.step(kSecond + 11'000'000, {&jump}, {});
  EXPECT_EQ(loop.counters().repositioned, 1u);
  EXPECT_NEAR(output.simulated.joints[index(Joint::wrist)].position[0], 10, 1e-3);
}

TEST(HandLoop, ABoneThatIsNotANumberIsRefusedAndTheOthersLive) {
  HandLoop loop(hand(), loop_options(), {});
  Skeleton sample = skeleton_at(hand(), {}, kSecond, 1);
  loop.step(kSecond, {&sample}, {});
  for (int i = 1; i <= 60; ++i) {
    const Nanoseconds now = kSecond + i * 11'111'111;
    sample = skeleton_at(hand(), {Vector3(0, 0.05, 0), Quaternion::Identity()}, now, static_cast<std::uint64_t>(i) + 1);
    sample.joints[index(Joint::index_intermediate)].position[1] = std::numeric_limits<double>::quiet_NaN();
    loop.step(now, {&sample}, {});
  }
  EXPECT_EQ(loop.counters().refused_nonfinite, 60u);
  EXPECT_EQ(loop.counters().failed_steps, 0u);
  EXPECT_NEAR(loop.simulation().joint_pose(Joint::little_tip).position.y(), 0.05, 5e-3);
  EXPECT_TRUE(all_finite(loop.simulation().state()));
}

TEST(HandLoop, OldSamplesAreRefused) {
  HandLoop loop(hand(), loop_options(), {});
  const Skeleton sample = skeleton_at(hand(), {}, kSecond, 5);
  loop.step(kSecond, {&sample}, {});
  loop.step(kSecond + 11'000'000, {&sample}, {});
  EXPECT_EQ(loop.counters().refused_order, 1u);
}

TEST(HandLoop, StaleInputIsSaidWithinATenthOfASecond) {
  HandLoop loop(hand(), loop_options(), {});
  const Skeleton sample = skeleton_at(hand(), {}, kSecond, 1);
  for (int i = 0; i < 20; ++i) loop.step(kSecond + i * 11'111'111, {i == 0 ? &sample : nullptr}, {});
  EXPECT_GT(loop.counters().stale_steps, 5u);
  EXPECT_LT(loop.counters().stale_steps, 12u);
}

ObjectDescription cube(std::uint32_t id) {
  ObjectDescription d;
  d.object = id;
  d.mass = 0.05;
  d.inertia = {1.33e-5, 1.33e-5, 1.33e-5};
  d.friction = 0.8;
  d.shape = box(0.02);
  return d;
}

WorldObjects world_with(std::uint32_t id, const Vector3& position, Nanoseconds time) {
  WorldObjects world;
  world.stamp.sample_time = time;
  ObjectState state;
  state.object = id;
  state.position = to_wire(position);
  world.objects.push_back(state);
  return world;
}

TEST(HandLoop, MirrorsWhatIsNearOwnsWhatItTouchesAndLetsGoLater) {
  const HandModel model = hand();
  HandLoop loop(model, loop_options(), {});
  loop.describe_object(cube(3));
  Nanoseconds now = kSecond;
  std::uint64_t sequence = 0;
  const auto step = [&](double wrist_y, const Vector3& object) -> const HandOutput& {
    now += 11'111'111;
    const Skeleton sample = skeleton_at(model, {Vector3(0, wrist_y, 0), Quaternion::Identity()}, now, ++sequence);
    const WorldObjects world = world_with(3, object, now);
    return loop.step(now, {&sample, nullptr, &world}, {});
  };
  const Vector3 below(-0.012, -0.018 - 0.02 - 0.001, -0.092);
  EXPECT_TRUE(step(0, Vector3(2, 0, 0)).coupling.twins.empty()) << "an object two metres away has no twin";
  const HandOutput& near = step(0, below);
  ASSERT_EQ(near.coupling.twins.size(), 1u);
  EXPECT_EQ(near.coupling.twins[0].owned, 0u);
  int steps_to_own = 0;
  while (step(-0.004, below).coupling.twins[0].owned == 0 && steps_to_own < 60) ++steps_to_own;
  EXPECT_LT(steps_to_own, 60) << "pressed on, the object becomes the hand's";
  int owned_steps = 0;
  while (step(0.03, below).coupling.twins[0].owned == 1 && owned_steps < 90) ++owned_steps;
  EXPECT_GE(owned_steps, 8) << "it stays the hand's for a tenth of a second";
  EXPECT_LT(owned_steps, 90);
}

// A whole step, from its inputs to all its outputs, with an object coming near, touched, held and let go.
TEST(HandLoop, AStepAllocatesNothing) {
#ifndef SOFTHAND_COUNT_MALLOC
  GTEST_SKIP() << "the sanitizer brings its own malloc";
#endif
  const HandModel model = hand();
  HandLoop loop(model, loop_options(), {});
  loop.describe_object(cube(3));
  Nanoseconds now = kSecond;
  std::uint64_t sequence = 0;
  const Vector3 below(-0.012, -0.018 - 0.02 - 0.001, -0.092);
  const auto samples = std::make_unique<std::pair<Skeleton, WorldObjects>>();
  bool touched = false;
  counting = true;
  ::operator delete(::operator new(64));
  counting = false;
  ASSERT_EQ(std::exchange(allocations, 0), 1) << "the counter counts nothing";
  for (int i = 0; i < 120; ++i) {
    now += 11'111'111;
    samples->first = skeleton_at(model, {Vector3(0, i < 60 ? -0.004 : 0.03, 0), Quaternion::Identity()}, now, ++sequence);
    samples->second = world_with(3, i < 5 ? Vector3(2, 0, 0) : below, now);
    counting = true;
    const HandOutput& output = loop.step(now, {&samples->first, nullptr, &samples->second}, {true, true, true});
    counting = false;
    touched = touched || output.contacts.contacts.size() > 0;
  }
  EXPECT_TRUE(touched);
  EXPECT_EQ(allocations, 0);
}

// From a state in which an object is held, at another loop's history of solver and slots.
TEST(HandLoop, GoesOnLikeTheLoopWhoseStateItTook) {
  const HandModel model = hand();
  HandLoop one(model, loop_options(), {}), two(model, loop_options(), {});
  one.describe_object(cube(3));
  two.describe_object(cube(3));
  const Vector3 below(-0.012, -0.018 - 0.02 - 0.001, -0.092);
  const auto step = [&](HandLoop& loop, int i) {
    const Nanoseconds now = kSecond + i * 11'111'111;
    const Skeleton sample = skeleton_at(model, {Vector3(0, -0.004, 0), Quaternion::Identity()}, now, static_cast<std::uint64_t>(i));
    const WorldObjects world = world_with(3, below, now);
    loop.step(now, {&sample, nullptr, &world}, {});
  };
  step(two, 1);
  int i = 1;
  while (i < 60 && (one.simulation().contact_count() == 0 || one.simulation().slot_mode(0) != SlotMode::dynamic)) step(one, i++);
  ASSERT_LT(i, 60) << "touched and owned";
  two.take_state(one);
  for (const int end = i + 20; i < end; ++i) {
    step(one, i);
    step(two, i);
    ASSERT_EQ(one.simulation().contact_count(), two.simulation().contact_count()) << i;
    ASSERT_EQ((one.simulation().state().node_positions - two.simulation().state().node_positions).cwiseAbs().maxCoeff(), 0) << i;
    ASSERT_EQ(one.simulation().slot_pose(0).position, two.simulation().slot_pose(0).position) << i;
  }
}

TEST(HandLoop, SlotsGoToTheNearestObjectsAndTheTouchedKeepTheirs) {
  const HandModel model = hand();
  HandLoop loop(model, loop_options(), {});  // one slot
  const Vector3 below(-0.012, -0.018 - 0.02 - 0.001, -0.092);
  constexpr std::uint32_t kFar = 3, kNear = 4;
  for (const std::uint32_t id : {kFar, kNear}) loop.describe_object(cube(id));
  Nanoseconds now = kSecond;
  std::uint64_t sequence = 0;
  const auto holder = [&](double wrist_y, double height_of_far, double height_of_near) {
    now += 11'111'111;
    const Skeleton sample = skeleton_at(model, {Vector3(0, wrist_y, 0), Quaternion::Identity()}, now, ++sequence);
    WorldObjects world = world_with(kFar, below + Vector3(0, height_of_far, 0), now);
    world.objects.push_back(world_with(kNear, below + Vector3(0, height_of_near, 0), now).objects[0]);
    const ObjectCoupling& coupling = loop.step(now, {&sample, nullptr, &world}, {}).coupling;
    return coupling.twins.size() == 1 ? coupling.twins[0].object : 0u;
  };
  EXPECT_EQ(holder(0, -0.02, -0.01), kNear) << "though the other was announced first";
  EXPECT_EQ(loop.counters().objects_without_slot, 1u);
  EXPECT_EQ(holder(0, -0.012, -0.014), kNear) << "it keeps the slot against an equal";
  EXPECT_EQ(holder(0, -0.01, -0.02), kFar);
  for (int i = 0; i < 30 && !loop.simulation().touched(0); ++i) holder(-0.004, 0, -0.02);
  ASSERT_TRUE(loop.simulation().touched(0));
  EXPECT_EQ(holder(-0.004, 0, 0.02), kFar) << "it is touched: nothing nearer takes its slot";
}

TEST(HandLoop, ManyObjectsOutOfReachGetNoSlotAndNoQuery) {
  const HandModel model = hand();
  HandLoop loop(model, loop_options(), {});
  const auto world = std::make_unique<WorldObjects>();
  world->stamp.sample_time = kSecond;
  for (std::uint32_t id = 1; id <= 100; ++id) {
    loop.describe_object(cube(id));
    world->objects.push_back(world_with(id, Vector3(1 + 0.1 * id, 0, 0), kSecond).objects[0]);
  }
  const Skeleton sample = skeleton_at(model, {}, kSecond, 1);
  const HandOutput& output = loop.step(kSecond, {&sample, nullptr, world.get()}, {});
  EXPECT_TRUE(output.coupling.twins.empty());
  EXPECT_EQ(loop.counters().objects_without_slot, 0u);
  EXPECT_EQ(loop.simulation().work().contact_queries, 0u);
}

TEST(HandLoop, ARemovedObjectLeavesItsSlot) {
  const HandModel model = hand();
  HandLoop loop(model, loop_options(), {});
  loop.describe_object(cube(3));
  const Skeleton sample = skeleton_at(model, {}, kSecond, 1);
  const WorldObjects world = world_with(3, Vector3(-0.012, -0.045, -0.092), kSecond);
  ASSERT_EQ(loop.step(kSecond, {&sample, nullptr, &world}, {}).coupling.twins.size(), 1u);
  ObjectDescription gone = cube(3);
  gone.removed = 1;
  loop.describe_object(gone);
  EXPECT_TRUE(loop.step(kSecond + 11'000'000, {nullptr, nullptr, &world}, {}).coupling.twins.empty());
}

TEST(HandLoop, WithoutTheIntermediateLayerItGivesTheBoneWrenchItself) {
  HandOptions o = loop_options();
  o.direct = true;
  const HandModel model = hand();
  HandLoop loop(model, o, {});
  Nanoseconds now = kSecond;
  for (int i = 1; i < 40; ++i) {
    now += 11'111'111;
    const Skeleton sample = skeleton_at(model, {Vector3(0, 0.001 * i, 0), Quaternion::Identity()}, now, static_cast<std::uint64_t>(i));
    loop.step(now, {&sample}, {});
  }
  EXPECT_NEAR(loop.simulation().joint_pose(Joint::middle_tip).position.y(), 0.039, 3e-3);
  const Skeleton sample = skeleton_at(model, {Vector3(0, 0.039, 0), Quaternion::Identity()}, now, 1000);
  const HandOutput& output = loop.step(now, {&sample}, {});
  EXPECT_EQ(output.bone_wrench.simulated_valid, 1u);
}

// What latencies are made of: without it no glove's chain would ever count as complete.
TEST(HandLoop, WithoutTheIntermediateLayerTheChainIsCompleteToo) {
  HandOptions o = loop_options();
  o.direct = true;
  const HandModel model = hand();
  HandLoop loop(model, o, {});
  Skeleton sample = skeleton_at(model, {}, kSecond, 1);
  sample.stamp.publish_time = kSecond + 1'000'000;
  const HandOutput& output = loop.step(kSecond + 5'000'000, {&sample}, {});
  const Chain& chain = output.bone_wrench.stamp.chain;
  EXPECT_EQ(chain.tracker_sample, kSecond);
  EXPECT_EQ(chain.tracked_published, kSecond + 1'000'000);
  EXPECT_EQ(chain.intermediate_published, 0);
  EXPECT_EQ(chain.wrench_published, kSecond + 5'000'000);
  EXPECT_EQ(output.simulated.stamp.chain.tracker_sample, kSecond);
}

TEST(HandLoop, UnwantedOutputsAreNotComputed) {
  HandLoop loop(hand(), loop_options(), {});
  const Skeleton sample = skeleton_at(hand(), {}, kSecond, 1);
  const HandOutput& output = loop.step(kSecond, {&sample}, {false, false, false});
  EXPECT_TRUE(output.surface.nodes.empty());
  EXPECT_EQ(output.contacts.stamp.sequence, 0u);
}

// An approach, a touch and a grip, with and without what the scene does not need.
TEST(HandLoop, WhatIsLeftOutChangesNoBitOfWhatIsKept) {
  const HandModel model = hand();
  struct Run {
    std::vector<State> states;
    bool touched = false;
  };
  const auto run = [&model](const HandOptions& options, const HandWants& wants, std::uint32_t far_objects) {
    HandLoop loop(model, options, {});
    loop.describe_object(cube(3));
    for (std::uint32_t id = 0; id < far_objects; ++id) loop.describe_object(cube(100 + id));
    Run result;
    Nanoseconds now = kSecond;
    for (int i = 0; i < 60; ++i) {
      now += 11'111'111;
      const Skeleton sample = skeleton_at(model, {Vector3(0, i < 20 ? 0.005 : -0.004, 0), Quaternion::Identity()}, now, static_cast<std::uint64_t>(i) + 1);
      WorldObjects world = world_with(3, Vector3(-0.012, -0.018 - 0.02 - 0.001, -0.092), now);
      for (std::uint32_t id = 0; id < far_objects; ++id) world.objects.push_back(world_with(100 + id, Vector3(1 + 0.1 * id, 0, 0), now).objects[0]);
      loop.step(now, {&sample, nullptr, &world}, wants);
      result.states.push_back(loop.simulation().state());
      result.touched = result.touched || loop.simulation().contact_count() > 0;
    }
    return result;
  };
  const auto largest_difference = [](const Run& left, const Run& right) {
    double largest = 0;
    for (std::size_t i = 0; i < left.states.size(); ++i) {
      largest = std::max(largest, (left.states[i].node_positions - right.states[i].node_positions).cwiseAbs().maxCoeff());
      for (std::size_t b = 0; b < kBodyCount; ++b) largest = std::max(largest, (left.states[i].body_poses[b].position - right.states[i].body_poses[b].position).norm());
    }
    return largest;
  };
  const HandWants nothing{false, false, false, false}, everything{true, true, true, true};
  const Run plain = run(loop_options(), nothing, 0);
  ASSERT_TRUE(plain.touched);
  EXPECT_EQ(largest_difference(run(loop_options(), everything, 0), plain), 0) << "topics that are read";
  EXPECT_EQ(largest_difference(run(loop_options(), nothing, 40), plain), 0) << "objects out of reach";
  // A slot that no object takes gives the matrix other columns and sums another order.
  HandOptions exact = loop_options();
  exact.simulation.solver.factor = "double";
  exact.simulation.solver.max_factorisations = exact.simulation.solver.max_iterations;
  exact.simulation.solver.residual_tolerance = 1e-9;
  HandOptions spare = exact;
  spare.mirrored_objects = 3;
  EXPECT_LE(largest_difference(run(spare, nothing, 0), run(exact, nothing, 0)), 1e-9) << "slots without objects";
}

}  // namespace
}  // namespace softhand
