// Flexible objects in the hand's simulation: motion, weight, contact with tables, rigid objects, the hand and each
// other.
#include <gtest/gtest.h>

#include "energies/skin_contact.hpp"
#include "geometry/shape.hpp"
#include "messages/convert.hpp"
#include "messages/plain_bytes.hpp"
#include "support/cores.hpp"
#include "support/count_allocations.hpp"
#include "support/soft_bodies.hpp"
#include "unit/hand_simulation_rig.hpp"

namespace softhand::soft_object_test {
namespace {

using namespace testing;

const Pose kFarAway{.position = {0, 1, 0}};
constexpr double kEdge = 0.04;

SoftObject cube_at(const Vector3& place, double youngs_modulus, const Vector3& gravity = kGravity) {
  return {.name = "cube",
          .body = soft_box({4, 4, 4}, Vector3::Constant(kEdge), soft_material(youngs_modulus)),
          .pose = {.position = place},
          .gravity = gravity};
}

const ShapeGeometry& table_shape() {
  static const ShapeGeometry shape(box_shape({0.4, 0.02, 0.4}));
  return shape;
}

// A simulation whose hand is far away and at rest.
std::unique_ptr<HandSimulation> alone(std::vector<SoftObject> objects, int mirrored_slots, int static_slots,
                                      const SimulationOptions& simulation_options = options()) {
  auto simulation = std::make_unique<HandSimulation>(hand(), simulation_options, mirrored_slots, static_slots,
                                                     ObjectSpring{}, 0, std::move(objects));
  simulation->reposition(kFarAway);
  set_rest_targets(*simulation, kFarAway);
  return simulation;
}

Vector3 momentum(const HandSimulation& simulation) {
  Vector3 sum = Vector3::Zero();
  const SoftObjects& soft = *simulation.soft();
  for (int n = soft.first_node(0); n < soft.first_node(soft.count()); ++n)
    sum += soft.node_masses()[static_cast<std::size_t>(n)] * simulation.state().node_velocities.col(n);
  return sum;
}

TEST(SoftObject, FallsAsBackwardEulerSays) {
  SimulationOptions exact = options();
  exact.solver.residual_tolerance = 1e-9;
  exact.solver.max_iterations = 30;
  const auto simulation = alone({cube_at({0, 0, 0}, 1e4)}, 0, 0, exact);
  EXPECT_NEAR(simulation->soft()->mass(0), 100 * kEdge * kEdge * kEdge, 1e-12);
  constexpr int kSteps = 18;
  for (int i = 0; i < kSteps; ++i) ASSERT_TRUE(simulation->step(kStep).state_changed);
  const double fall = 0.5 * kSteps * (kSteps + 1) * kStep * kStep * 9.81;
  EXPECT_NEAR(-centre_of_mass(*simulation->soft(), 0, simulation->state()).y(), fall, 1e-5 * fall);
}

TEST(SoftObject, RestsOnATableWithItsWeight) {
  for (const double modulus : {1e3, 1e4, 1e5, 1e6, 1e7}) {
    const auto simulation = alone({cube_at({0, 0.5 * kEdge + 1e-4, 0}, modulus)}, 0, 1);
    set_table(*simulation, 0, table_shape(), 0.02);
    constexpr int kSteps = 270, kMeasured = 90;
    double force = 0;
    for (int i = 0; i < kSteps; ++i) {
      ASSERT_TRUE(simulation->step(kStep).state_changed);
      if (i >= kSteps - kMeasured) force -= simulation->contact_wrench(0).force.y() / kMeasured;
    }
    const double weight = simulation->soft()->mass(0) * 9.81;
    EXPECT_NEAR(force / weight, 1, 0.01) << modulus;
    EXPECT_LT(simulation->soft()->fastest(0, simulation->state()), 1e-4) << modulus;
    EXPECT_EQ(simulation->inverted_elements(), 0) << modulus;
    EXPECT_TRUE(simulation->touched(0));
  }
}

// The table leans by 0.3 rad. tan(0.3) = 0.309. The cube settles first.
TEST(SoftObject, SlidesDownASlopeOnlyIfFrictionIsTooSmall) {
  for (const auto& [friction, slides] : {std::pair(0.35, false), std::pair(0.15, true)}) {
    const Quaternion lean(Eigen::AngleAxisd(0.3, Vector3::UnitZ()));
    SoftObject cube = cube_at(lean * Vector3(0, 0.5 * kEdge + 1e-4, 0), 1e5);
    cube.pose.orientation = lean;
    const auto simulation = alone({cube}, 0, 1);
    simulation->set_slot(0, {.id = 1, .shape = &table_shape(), .friction = friction});
    simulation->set_slot_motion(0, {lean * Vector3(0, -0.02, 0), lean}, {});
    const auto speed = [&] { return momentum(*simulation).norm() / simulation->soft()->mass(0); };
    for (int i = 0; i < 25; ++i) simulation->step(kStep);
    const double before = speed();
    constexpr int kMeasured = 20;
    for (int i = 0; i < kMeasured; ++i) simulation->step(kStep);
    if (slides) {
      const double expected = kMeasured * kStep * 9.81 * (std::sin(0.3) - friction * std::cos(0.3));
      EXPECT_NEAR(speed() - before, expected, 0.02 * expected);
    } else {
      EXPECT_LT(speed(), 1e-4);
    }
  }
}

TEST(SoftObject, CarriesARigidObject) {
  const auto simulation = alone({cube_at({0, 0.5 * kEdge + 1e-4, 0}, 2e4)}, 1, 1);
  set_table(*simulation, 1, table_shape(), 0.02);
  const ShapeGeometry box(box_shape({0.03, 0.01, 0.03}));
  const double mass = 0.05;
  simulation->set_slot(0, {.id = 2,
                           .shape = &box,
                           .mass = mass,
                           .inertia = mass / 3 * Vector3(1e-3, 1.8e-3, 1e-3).asDiagonal(),
                           .friction = 0.8});
  simulation->set_slot_motion(0, {.position = {0, kEdge + 0.0105, 0}}, {});
  simulation->make_dynamic(0, kGravity);
  constexpr int kSteps = 360, kMeasured = 90;
  double on_box = 0, on_table = 0;
  for (int i = 0; i < kSteps; ++i) {
    ASSERT_TRUE(simulation->step(kStep).state_changed);
    if (i < kSteps - kMeasured) continue;
    on_box += simulation->contact_wrench(0).force.y() / kMeasured;
    on_table -= simulation->contact_wrench(1).force.y() / kMeasured;
  }
  EXPECT_NEAR(on_box / (mass * 9.81), 1, 0.01);
  EXPECT_NEAR(on_table / ((mass + simulation->soft()->mass(0)) * 9.81), 1, 0.01);
  EXPECT_LT(std::abs(simulation->slot_pose(0).position.x()), 1e-3);
}

TEST(SoftObject, TwoObjectsCollideAndKeepTheirMomentum) {
  SimulationOptions exact = options();
  exact.solver.residual_tolerance = 1e-8;
  exact.solver.movement_tolerance = 1e-10;
  exact.solver.increment_tolerance = 1e-13;
  exact.solver.max_iterations = 200;
  const Vector3 none = Vector3::Zero();
  const auto simulation = alone({cube_at({0, 0, 0}, 1e4, none), cube_at({0.05, 0.003, 0.002}, 1e4, none)}, 0, 0, exact);
  State state = simulation->state();
  const SoftObjects& soft = *simulation->soft();
  state.node_velocities.middleCols(soft.first_node(1), soft.node_count(1)).colwise() = Vector3(-1, 0, 0);
  simulation->restore(state);
  const Vector3 before = momentum(*simulation);
  bool touched = false;
  for (int i = 0; i < 40; ++i) {
    ASSERT_TRUE(simulation->step(1e-3).state_changed);
    touched = touched || !soft.skin().anchors().empty();
    EXPECT_LE((soft.skin_force(0) + soft.skin_force(1)).norm(), 1e-9);
  }
  EXPECT_TRUE(touched);
  EXPECT_LE((momentum(*simulation) - before).norm(), 1e-3 * before.norm());
  EXPECT_GT(centre_of_mass(soft, 1, simulation->state()).x() - centre_of_mass(soft, 0, simulation->state()).x(), 0.03);
}

// A cube falls on the back of the hand. The hand carries its weight.
std::unique_ptr<HandSimulation> on_the_hand(double youngs_modulus, const SimulationOptions& simulation_options) {
  const Pose wrist{.position = {0, 0, 0}};
  auto simulation = std::make_unique<HandSimulation>(
      hand(), simulation_options, 0, 0, ObjectSpring{}, 0,
      std::vector<SoftObject>{cube_at({-0.03, 0.018 + 0.5 * kEdge + 1e-3, -0.09}, youngs_modulus)});
  set_rest_targets(*simulation, wrist);
  return simulation;
}

TEST(SoftObject, TheHandCarriesItsWeight) {
  for (const double modulus : {1e3, 1e4, 1e5, 1e6, 1e7}) {
    const auto simulation = on_the_hand(modulus, options());
    constexpr int kSteps = 360, kMeasured = 90;
    double force = 0, on_bones = 0;
    for (int i = 0; i < kSteps; ++i) {
      ASSERT_TRUE(simulation->step(kStep).state_changed);
      if (i < kSteps - kMeasured) continue;
      force += simulation->soft()->skin_force(0).y() / kMeasured;
      for (const Vector3& each : simulation->bone_contact_forces()) on_bones -= each.y() / kMeasured;
    }
    const double weight = simulation->soft()->mass(0) * 9.81;
    EXPECT_NEAR(force / weight, 1, 0.01) << modulus;
    EXPECT_NEAR(on_bones / weight, 1, 0.01) << modulus;
    EXPECT_EQ(simulation->inverted_elements(), 0) << modulus;
    EXPECT_LE(simulation->soft()->skin().deepest_penetration(simulation->state()), 2e-4) << modulus;
  }
}

// What the topics say of the cube on the hand.
TEST(SoftObject, ItsContactsAndNodesAreReported) {
  const auto simulation = on_the_hand(2e4, options());
  const SoftObjects& soft = *simulation->soft();
  for (int i = 0; i < 180; ++i) ASSERT_TRUE(simulation->step(kStep).state_changed);
  auto contacts = std::make_unique<Contacts>();
  auto state = std::make_unique<SoftObjectState>();
  allocations = 0;
  counting = true;
  simulation->write_contacts(*contacts);
  soft.write_state(0, simulation->state(), *state);
  counting = false;
  EXPECT_EQ(allocations, 0);
  Vector3 of_contacts = Vector3::Zero(), of_fingers = Vector3::Zero();
  double area = 0;
  for (const Contact& each : contacts->contacts) {
    EXPECT_EQ(each.object, kFirstSoftObject);
    EXPECT_LT(each.node, static_cast<std::uint32_t>(simulation->hand().node_count()));
    EXPECT_LT(each.body, static_cast<std::uint32_t>(kBodyCount));
    EXPECT_GE(to_vector(each.force).dot(to_vector(each.normal)), 0) << "the normal points out of the cube";
    of_contacts += to_vector(each.force);
    area += each.area;
  }
  for (const FingerContact& finger : contacts->fingers) {
    of_fingers += to_vector(finger.force);
    EXPECT_EQ(finger.object, finger.contact_count > 0 ? kFirstSoftObject : 0u);
  }
  const Vector3 on_cube = soft.skin_force(0);
  EXPECT_GT(on_cube.y(), 0.5 * soft.mass(0) * 9.81);
  EXPECT_LE((of_contacts + on_cube).norm(), 1e-9);
  EXPECT_LE((of_fingers + on_cube).norm(), 1e-9);
  EXPECT_LE((to_vector(state->hand_force) - on_cube).norm(), 1e-12);
  EXPECT_EQ(state->contact_count, contacts->contacts.size());
  EXPECT_GT(area, 0);
  EXPECT_LT(area, 1.2 * kEdge * kEdge) << "a place that is touched from both sides counts once";

  ASSERT_EQ(static_cast<int>(state->nodes.size()), soft.node_count(0));
  double farthest = 0;
  for (int n = 0; n < soft.node_count(0); ++n) {
    const auto& relative = state->nodes[static_cast<std::size_t>(n)];
    const Vector3 place = to_vector(state->centre) + Vector3(relative[0], relative[1], relative[2]);
    farthest = std::max(farthest, (place - simulation->state().node_positions.col(soft.first_node(0) + n)).norm());
  }
  EXPECT_LT(farthest, 1e-8);
  EXPECT_LE((to_vector(state->centre) - centre_of_mass(soft, 0, simulation->state())).norm(), 1e-12);
}

TEST(SoftObject, GoesBackToItsStart) {
  const auto simulation = on_the_hand(2e4, options());
  const SoftObjects& soft = *simulation->soft();
  for (int i = 0; i < 60; ++i) ASSERT_TRUE(simulation->step(kStep).state_changed);
  const auto nodes_of = [&](const Eigen::Matrix3Xd& all) {
    return Eigen::Matrix3Xd(all.middleCols(soft.first_node(0), soft.node_count(0)));
  };
  ASSERT_NE(nodes_of(simulation->state().node_positions), nodes_of(soft.start_positions()));
  allocations = 0;
  counting = true;
  simulation->restart_soft_object(0);
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_EQ(nodes_of(simulation->state().node_positions), nodes_of(soft.start_positions()));
  EXPECT_EQ(nodes_of(simulation->state().node_velocities).norm(), 0);
  EXPECT_TRUE(soft.skin().anchors().empty());
  for (int i = 0; i < 180; ++i) ASSERT_TRUE(simulation->step(kStep).state_changed);
  EXPECT_NEAR(soft.skin_force(0).y() / (soft.mass(0) * 9.81), 1, 0.05) << "it lies on the hand again";
}

// The cube is put back into a hand that is there. Contact would turn its tetrahedra inside out.
TEST(SoftObject, PassesThroughAHandItIsPutBackInto) {
  const auto simulation = on_the_hand(2e4, options());
  const SoftObjects& soft = *simulation->soft();
  const Pose into{.position = {0, 0.5 * kEdge, 0}};
  const auto advance = [&](const Pose& wrist, int steps) {
    set_rest_targets(*simulation, wrist);
    for (int i = 0; i < steps; ++i) {
      ASSERT_TRUE(simulation->step(kStep).state_changed);
      EXPECT_EQ(soft.tissue().inverted_elements(simulation->state()), 0);
    }
  };
  simulation->reposition(into);
  simulation->restart_soft_object(0);
  advance(into, 3);  // without a table it falls
  EXPECT_EQ(soft.passing(), 1);
  EXPECT_TRUE(soft.skin().anchors().empty());

  // The state of a copy goes on in the same way.
  const auto copy = on_the_hand(2e4, options());
  set_rest_targets(*copy, into);
  copy->take_state(*simulation);
  EXPECT_EQ(copy->soft()->passing(), 1);

  // After the hand has left, the cube falls on it again.
  simulation->reposition(kFarAway);
  advance(kFarAway, 1);
  EXPECT_EQ(soft.passing(), 0);
  simulation->reposition({});
  simulation->restart_soft_object(0);
  advance({}, 180);
  EXPECT_EQ(soft.passing(), 0);
  EXPECT_NEAR(soft.skin_force(0).y() / (soft.mass(0) * 9.81), 1, 0.05);

  simulation->pass_through(true);
  advance({}, 1);
  EXPECT_EQ(soft.passing(), 1);
}

// A jump of the tracker left three tetrahedra of a held ball inverted for good, in steps that converged. They were too
// few for the ball to get its rest shape.
TEST(SoftObject, AFewInvertedTetrahedraAreUnfoldedInTheirSurroundings) {
  SoftObjects soft(hand(), {cube_at({0, 0, 0}, 1e4)});
  std::vector<std::unique_ptr<Energy>> terms;
  soft.add_terms({.contact_stiffness = 1e8}, terms);
  SkinContact skin(soft.model(), soft.node_masses(), 1e8, 0.5, soft.frictions());
  soft.use(skin);
  // The cube is squeezed to half of its height, and one of its inner nodes is pushed through its neighbours.
  State state;
  state.node_positions = soft.start_positions();
  state.node_positions.row(1) *= 0.5;
  state.node_velocities.setZero(3, state.node_positions.cols());
  const int first = soft.first_node(0);
  Eigen::Index inner = 0;
  state.node_positions.rightCols(soft.node_count(0)).colwise().squaredNorm().minCoeff(&inner);
  inner += first;
  const Eigen::Matrix3Xd squeezed = state.node_positions;
  state.node_positions.col(inner) += Vector3(0.5 * kEdge, 0, 0);
  ASSERT_GT(soft.tissue().inverted_elements(state), 0);
  EXPECT_EQ(soft.untangle(state, 0.05, false), 0) << "it may come back alone";
  EXPECT_GT(soft.untangle(state, 0.06, true), 0);
  EXPECT_EQ(soft.tissue().inverted_elements(state), 0);
  EXPECT_LT((state.node_positions - squeezed).colwise().norm().maxCoeff(), 1e-6);
  EXPECT_EQ(soft.untangle(state, 1, true), 0) << "nothing is inverted";
}

// Such steps began the time of a tangle again. Then hand and object pressed each other for longer than 0.1 s.
TEST(SoftObject, AStepWithFewInvertedTetrahedraDoesNotEndATangle) {
  constexpr int kFew = 6;  // at most 0.5 % of the tetrahedra
  SoftObject cube = cube_at({0, 0, 0}, 1e4);
  cube.body = soft_box({6, 6, 6}, Vector3::Constant(kEdge), soft_material(1e4));
  ASSERT_LE(kFew, 0.005 * static_cast<double>(cube.body->tetrahedra.size()));
  SoftObjects soft(hand(), {cube});
  SkinContact skin(soft.model(), soft.node_masses(), 1e8, 0.5, soft.frictions());
  std::vector<std::unique_ptr<Energy>> terms;
  soft.add_terms({.contact_stiffness = 1e8}, terms);
  soft.use(skin);
  soft.load({.tangled = {0.05}, .inverted = {0}});
  State mirrored, few_inverted;
  for (State* state : {&mirrored, &few_inverted}) {
    state->node_positions = soft.start_positions();
    state->node_velocities.setZero(3, state->node_positions.cols());
  }
  mirrored.node_positions.rightCols(soft.node_count(0)).row(0) *= -1;
  few_inverted.node_positions.col(soft.first_node(1) - 1) *= 0.6;  // a corner of the cube goes through its tetrahedra
  ASSERT_GT(soft.tissue().inverted_elements(few_inverted), 0);
  ASSERT_LE(soft.tissue().inverted_elements(few_inverted), kFew);
  const double& tangled = soft.save().tangled[0];
  soft.untangle(mirrored, 0.02, false);
  EXPECT_NEAR(tangled, 0.07, 1e-12);
  soft.untangle(few_inverted, 0.02, false);
  EXPECT_NEAR(tangled, 0.07, 1e-12);
  EXPECT_EQ(soft.untangle(mirrored, 0.04, false), soft.node_count(0)) << "after 0.1 s it gets its shape";
  soft.load({.tangled = {0.05}, .inverted = {0}});
  soft.untangle(few_inverted, 0.02, true);
  EXPECT_EQ(tangled, 0) << "the step converged";
}

// The cube starts 3 mm inside the hand and comes out without a bang.
TEST(SoftObject, LeavesTheHandThatItStartsIn) {
  auto simulation = std::make_unique<HandSimulation>(
      hand(), options(), 0, 0, ObjectSpring{}, 0,
      std::vector<SoftObject>{cube_at({-0.03, 0.018 + 0.5 * kEdge - 3e-3, -0.09}, 2e4)});
  set_rest_targets(*simulation, {});
  double fastest = 0;
  for (int i = 0; i < 180; ++i) {
    ASSERT_TRUE(simulation->step(kStep).state_changed);
    fastest = std::max(fastest, simulation->soft()->fastest(0, simulation->state()));
  }
  EXPECT_LT(fastest, 1.5);
  EXPECT_LE(simulation->soft()->skin().deepest_penetration(simulation->state()), 2e-4);
  EXPECT_EQ(simulation->inverted_elements(), 0);
}

TEST(SoftObject, ASceneWithoutItHasNoTermAndNoWork) {
  HandSimulation simulation(hand(), options(), 0, 1);
  set_table(simulation, 0, table_shape(), 0.5);
  set_rest_targets(simulation, {});
  simulation.enable_ledger(true);
  simulation.step(kStep);
  EXPECT_EQ(simulation.soft(), nullptr);
  EXPECT_EQ(simulation.work().soft_elements, 0u);
  simulation.for_each_stored(
      [](std::string_view name, double) { EXPECT_EQ(name.find("soft"), std::string_view::npos) << name; });
  EXPECT_EQ(simulation.state().node_positions.cols(), simulation.hand().node_count());
}

// A far object changes the hand's factor and convergence test, but not its motion beyond the solver's tolerance.
TEST(SoftObject, AFarObjectDoesNotMoveTheHand) {
  SimulationOptions exact = options();
  exact.solver.residual_tolerance = 1e-7;
  exact.solver.max_iterations = 50;
  HandSimulation without(hand(), exact, 0, 0);
  HandSimulation with(hand(), exact, 0, 0, {}, 0, {cube_at({3, 0, 0}, 1e4)});
  for (int i = 0; i < 60; ++i) {
    const Pose wrist{.position = {0, 0.05 * std::sin(3 * i * kStep), 0}};
    for (HandSimulation* simulation : {&without, &with}) {
      set_rest_targets(*simulation, wrist);
      simulation->step(kStep);
    }
  }
  EXPECT_LE((with.state().node_positions.leftCols(without.hand().node_count()) - without.state().node_positions)
                .cwiseAbs()
                .maxCoeff(),
            1e-5);
  EXPECT_TRUE(with.soft()->skin().anchors().empty());
}

TEST(SoftObject, TheLedgerCloses) {
  SimulationOptions exact = options();
  exact.solver.residual_tolerance = 1e-7;
  exact.solver.max_iterations = 50;
  const auto simulation = on_the_hand(2e4, exact);
  simulation->enable_ledger(true);
  for (int i = 0; i < 180; ++i) simulation->step(kStep);
  EXPECT_LE(simulation->ledger().defect(), 0.01);
  EXPECT_LE(simulation->ledger().excess(), 0.01);
  bool has_soft = false;
  simulation->for_each_stored([&](std::string_view name, double joules) {
    if (name == "soft_tissue") has_soft = joules > 0;
  });
  EXPECT_TRUE(has_soft);
}

TEST(SoftObject, TwoThreadsAndTwoRunsGiveTheSameBits) {
  SimulationOptions two = options();
  two.threads = testing::allowed_cores() < 2 ? 1 : 2;
  const auto first = on_the_hand(1e4, options()), second = on_the_hand(1e4, two);
  for (int i = 0; i < 90; ++i) {
    first->step(kStep);
    second->step(kStep);
    ASSERT_EQ(first->state().node_positions, second->state().node_positions) << i;
    ASSERT_EQ(first->state().node_velocities, second->state().node_velocities) << i;
  }
  EXPECT_FALSE(first->soft()->skin().anchors().empty());
}

TEST(SoftObject, SavedStateContinuesWithTheSameBits) {
  const auto first = on_the_hand(1e4, options()), second = on_the_hand(1e4, options());
  for (int i = 0; i < 60; ++i) first->step(kStep);
  ASSERT_FALSE(first->soft()->skin().anchors().empty());
  std::vector<std::byte> bytes(8 << 20);
  ByteWriter out(bytes);
  first->save(out);
  ASSERT_FALSE(out.overflowed());
  first->forget();
  bytes.resize(out.size());
  ByteReader in(bytes);
  second->load(in);
  for (int i = 0; i < 30; ++i) {
    first->step(kStep);
    second->step(kStep);
    ASSERT_EQ(first->state().node_positions, second->state().node_positions) << i;
  }
}

#ifdef SOFTHAND_COUNT_MALLOC
TEST(SoftObject, StepsDoNotAllocate) {
  const auto simulation = on_the_hand(1e4, options());
  simulation->step(kStep);
  for (int i = 0; i < 90; ++i) {
    allocations = 0;
    counting = true;
    simulation->step(kStep);
    counting = false;
    ASSERT_EQ(allocations, 0) << i;
  }
  EXPECT_FALSE(simulation->soft()->skin().anchors().empty());
}
#endif

}  // namespace
}  // namespace softhand::soft_object_test
