#include "scene/hand_simulation.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <memory>
#include <vector>

#include "energies/contact.hpp"
#include "energies/memory.hpp"
#include "energies/skeleton_tissue.hpp"
#include "energies/tissue.hpp"
#include "math/rotation.hpp"
#include "scene/rest_error.hpp"
#include "solver/block_cholesky.hpp"
#include "support/block_hand.hpp"
#include "support/cores.hpp"
#include "support/moving_together.hpp"
#include "support/shapes.hpp"

namespace softhand {
namespace {

using testing::cube_shape;

constexpr double kStep = 1.0 / 90;

std::size_t index(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }

// A hand whose tissue is attached well enough to follow its bones.
HandModel hand() { return testing::block_hand(1); }

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
    worst = std::max(worst, (simulation.joint_pose(static_cast<Joint>(j)).position -
                             wrist * simulation.hand().rest_joints[j].position)
                                .norm());
  }
  return worst;
}

// Eigen's vectors are not zero by themselves. So the object is made in memory that is not zero.
TEST(HandSimulation, ANewHandHasNoContactForces) {
  std::vector<std::max_align_t> memory(sizeof(HandSimulation) / sizeof(std::max_align_t) + 1);
  std::memset(memory.data(), 0x5a, memory.size() * sizeof(memory[0]));
  auto* hand = new (memory.data()) HandSimulation(testing::block_hand(2), {}, 0, 0);
  for (const Vector3& force : hand->bone_contact_forces()) EXPECT_EQ(force, Vector3::Zero());
  std::destroy_at(hand);
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

TEST(HandSimulation, RepositioningMovesTheHandRigidly) {
  HandSimulation simulation(hand(), options(), 0, 0);
  const Pose wrist{Vector3(10, -3, 2), rotation_exp(Vector3(0, 2, 1))};
  simulation.reposition(wrist);
  set_rest_targets(simulation, wrist);
  EXPECT_LE(worst_joint_error(simulation, wrist), 1e-12);
  for (int i = 0; i < 10; ++i) simulation.step(kStep);
  EXPECT_LE(worst_joint_error(simulation, wrist), 1e-8);
}

TEST(HandSimulation, ContinuesFromARestoredState) {
  HandSimulation simulation(hand(), options(), 0, 0);
  set_rest_targets(simulation, {Vector3(0.03, 0, 0), Quaternion::Identity()});
  for (int i = 0; i < 5; ++i) simulation.step(kStep);
  const State saved = simulation.state();
  simulation.step(kStep);
  const Eigen::Matrix3Xd once = simulation.state().node_positions;
  simulation.restore(saved);
  simulation.step(kStep);
  // Not equal to the bit, because factors of earlier steps are reused.
  EXPECT_LE((simulation.state().node_positions - once).colwise().norm().maxCoeff(), 2e-5);
  State other = saved;
  other.body_poses.pop_back();
  EXPECT_THROW(simulation.restore(other), std::invalid_argument);
}

// A cube of 40 mm on a plane, far from the hand.
struct CubeOnAPlane {
  explicit CubeOnAPlane(double mass) {
    set_rest_targets(simulation, {});
    simulation.set_slot(0, {1, &cube, mass, mass * 0.0016 / 6 * Matrix3::Identity(), 0.8});
    simulation.set_slot_motion(0, {Vector3(1, 0.02, 0), Quaternion::Identity()}, {});
    plane.neighbour = 2;
    plane.normal = {0, 1, 0};
    plane.friction = 0.5;
  }
  void step(const Vector3& gravity) {
    simulation.make_dynamic(0, gravity);
    simulation.set_planes(0, {&plane, 1});
    simulation.step(kStep);
  }
  const ShapeGeometry cube{cube_shape(0.02)};
  HandSimulation simulation{hand(), options(), 1, 0};
  NeighbourPlane plane;
};

// The plane on which the object rested causes no friction at the object's new place.
TEST(HandSimulation, RestoringAStateReleasesTheObjectFromItsPlane) {
  CubeOnAPlane rig(0.05);
  for (int i = 0; i < 30; ++i) rig.step({0, -9.81, 0});
  State thrown = rig.simulation.state();
  thrown.body_poses[kBodyCount].position.y() += 1;
  thrown.body_velocities[kBodyCount] = {Vector3(1, 0, 0), Vector3::Zero()};
  rig.simulation.restore(thrown);
  rig.simulation.step(kStep);
  EXPECT_NEAR(rig.simulation.slot_velocity(0).linear.x(), 1, 1e-5);
  EXPECT_LE(rig.simulation.slot_velocity(0).angular.norm(), 1e-5);
}

// The depth is at most half a millimetre for any gravity of the world. This also holds for a floating object, which had
// no gravity when it was first touched.
TEST(HandSimulation, DepthInAPlaneDoesNotGrowWithGravity) {
  for (const bool floating : {false, true}) {
    CubeOnAPlane rig(5);
    for (int i = 0; i < 60; ++i) rig.step({0, floating && i == 0 ? 0.0 : -50.0, 0});
    const double depth = 0.02 - rig.simulation.slot_pose(0).position.y();
    EXPECT_GT(depth, 1e-4);
    EXPECT_LE(depth, 0.51e-3);
  }
}

// Moves every node to a random place in the hand's bounding box. The tissue's energy has many minima with inverted
// tetrahedra.
void scatter_nodes(HandSimulation& simulation) {
  State state = simulation.state();
  const Vector3 low = state.node_positions.rowwise().minCoeff(), high = state.node_positions.rowwise().maxCoeff();
  testing::Random random(1);
  for (Eigen::Index n = 0; n < state.node_positions.cols(); ++n) {
    state.node_positions.col(n) = 0.5 * (low + high) + 0.5 * (high - low).cwiseProduct(random.vector());
  }
  simulation.restore(state);
}

TEST(HandSimulation, UntanglesTissueThatStaysInverted) {
  double remaining_error = 0;
  const auto inverted_after = [&remaining_error](double period, std::uint64_t& untangled) {
    SimulationOptions o = options();
    o.untangle_patience = period;
    HandSimulation simulation(hand(), o, 0, 0);
    set_rest_targets(simulation, {});
    scatter_nodes(simulation);
    for (int i = 0; i < 180; ++i) simulation.step(kStep);
    untangled = simulation.untangled_nodes();
    remaining_error = rest_error(hand(), simulation.state());
    return simulation.inverted_elements();
  };
  std::uint64_t untangled = 0;
  EXPECT_GT(inverted_after(0, untangled), 0) << "the tissue recovered by itself: this test shows nothing";
  EXPECT_GT(remaining_error, 1e-4) << "rest_error must measure the remaining damage";
  EXPECT_EQ(untangled, 0u);
  EXPECT_EQ(inverted_after(SimulationOptions{}.untangle_patience, untangled), 0);
  EXPECT_LT(remaining_error, 1e-7);
  EXPECT_GT(untangled, 0u);
}

// The state is taken over just after nodes were untangled. The ledgers of both simulations hold the work of this.
TEST(HandSimulation, LedgerContinuesAlikeAfterTakeState) {
  HandSimulation one(hand(), options(), 0, 0), two(hand(), options(), 0, 0);
  for (HandSimulation* simulation : {&one, &two}) {
    set_rest_targets(*simulation, {});
    simulation->enable_ledger(true);
    simulation->step(kStep);
  }
  scatter_nodes(one);
  for (int i = 0; i < 180 && one.untangled_nodes() == 0; ++i) one.step(kStep);
  ASSERT_GT(one.untangled_nodes(), 0u);
  two.take_state(one);
  one.step(kStep);
  two.step(kStep);
  EXPECT_EQ((one.state().node_positions - two.state().node_positions).cwiseAbs().maxCoeff(), 0);
  EXPECT_EQ(one.ledger().total().work, two.ledger().total().work);
}

// The marks of one full check count in the next one.
TEST(Untangler, MemoryRepeatsTheBits) {
  const HandModel model = hand();
  const State rest = HandSimulation(model, options(), 0, 0).state();
  Tissue tissue(model);
  SkeletonTissue attachments(model, rest.layout());
  for (double distance = 0.1; distance > 1e-3; distance *= 0.7) {
    State tangled = rest;
    tangled.node_positions.col(0) += distance * Vector3(0.48, 0.6, 0.64);
    Untangler first(model, 0.1), loaded(model, 0.1), fresh(model, 0.1);
    if (first.full_check(tangled, nullptr, 0, tissue, attachments) > 0) continue;  // so much energy is put back at once
    loaded.load(first.save());
    State one = tangled, two = tangled, three = tangled;
    const int moved = first.full_check(one, nullptr, 0, tissue, attachments);
    if (moved == 0) continue;
    EXPECT_EQ(loaded.full_check(two, nullptr, 0, tissue, attachments), moved);
    EXPECT_EQ((one.node_positions - two.node_positions).cwiseAbs().maxCoeff(), 0);
    EXPECT_EQ(loaded.save().tangled, first.save().tangled);
    EXPECT_EQ(loaded.save().wait, first.save().wait);
    EXPECT_EQ(fresh.full_check(three, nullptr, 0, tissue, attachments), 0);
    first.load(loaded.save());
    first.reset();
    EXPECT_EQ(first.save().tangled, std::vector<std::uint8_t>(model.tetrahedra.size(), 0));
    return;
  }
  FAIL() << "no distance is tangled: this test shows nothing";
}

TEST(HandSimulation, UntanglesTissueThatStaysTwisted) {
  // Tissue that was collapsed to a line expands again wound about its bones. No tetrahedron is inverted then.
  const HandModel shipped = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  const auto distance_after = [&shipped](double period, std::uint64_t& untangled) {
    SimulationOptions o;
    o.untangle_patience = period;
    HandSimulation simulation(shipped, o, 0, 0);
    for (int b = 0; b < kBodyCount; ++b)
      simulation.set_target(static_cast<Body>(b), shipped.rest_joints[index(joint_of(static_cast<Body>(b)))], {});
    const State rest = simulation.state();
    State state = rest;
    const Vector3 middle = state.node_positions.rowwise().mean();
    testing::Random random(7);
    for (Eigen::Index n = 0; n < state.node_positions.cols(); ++n) {
      state.node_positions.col(n) =
          middle + Vector3(0, 0, state.node_positions(2, n) - middle.z()) + 1e-12 * random.vector();
    }
    simulation.restore(state);
    for (int i = 0; i < 200; ++i) simulation.step(kStep);
    untangled = simulation.untangled_nodes();
    return std::sqrt((simulation.state().node_positions - rest.node_positions).squaredNorm() / shipped.node_count());
  };
  std::uint64_t untangled = 0;
  EXPECT_GT(distance_after(0, untangled), 1e-3) << "the tissue recovered by itself: this test shows nothing";
  EXPECT_EQ(untangled, 0u);
  EXPECT_LT(distance_after(SimulationOptions{}.untangle_patience, untangled), 1e-4);
  EXPECT_GT(untangled, 0u);
}

// The shipped hand over a sphere. The palm nearly touches the sphere.
struct HandOverASphere {
  HandModel hand = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  ShapeGeometry sphere = ShapeGeometry(testing::sphere_shape(0.03));
  HandSimulation simulation{hand, {}, 1, 1};
  Eigen::Matrix3Xd rest = simulation.state().node_positions;
  int slot;
  Pose place;
  double fastest = 0;  // m/s, of the sphere

  explicit HandOverASphere(bool free) : slot(free ? 0 : 1) {
    constexpr double kGap = 1e-3, kMass = 0.1;  // m, kg
    set_rest_targets(simulation, {});
    place.position = hand.rest_joints[index(Joint::palm)].position - Vector3(0, 0.1, 0);
    for (int i = 0; i < 50; ++i) {
      double nearest = 1;
      for (const Vector3& node : hand.nodes)
        nearest = std::min(nearest, sphere.signed_distance(place.inverse() * node));
      place.position.y() += nearest - kGap;
    }
    simulation.set_slot(slot, {7, &sphere, kMass, kMass * 0.4 * 9e-4 * Matrix3::Identity(), 0.8});
    simulation.set_slot_motion(slot, place, {});
    if (free) simulation.make_dynamic(slot, Vector3::Zero());
  }
  double distance() const {
    return std::sqrt((simulation.state().node_positions - rest).squaredNorm() / hand.node_count());
  }
  void run(int steps) {
    for (int i = 0; i < steps; ++i) {
      simulation.step(kStep);
      fastest = std::max(fastest, simulation.slot_velocity(slot).linear.norm());
    }
  }
};

TEST(HandSimulation, CollapsedOrMirroredTissueRecoversWithAnObjectInThePalm) {
  for (const bool free : {false, true}) {
    for (const Vector3& map : {Vector3(1, 0, 1), Vector3(0, 1, 1), Vector3(1, 1, 0), Vector3(1, -1, 1),
                               Vector3(-1, 1, 1), Vector3(1, 1, -1)}) {
      SCOPED_TRACE(::testing::Message() << (free ? "free, " : "fixed, ") << map.transpose());
      HandOverASphere scene(free);
      State state = scene.simulation.state();
      const Vector3 middle = state.node_positions.rowwise().mean();
      for (Eigen::Index n = 0; n < state.node_positions.cols(); ++n) {
        state.node_positions.col(n) = middle + map.cwiseProduct(Vector3(state.node_positions.col(n) - middle));
      }
      scene.simulation.restore(state);
      const double before = scene.distance();
      scene.run(90);
      EXPECT_LE(scene.distance(), 0.05 * before);
      EXPECT_EQ(scene.simulation.inverted_elements(), 0);
      EXPECT_LE(scene.fastest, 1.0) << "the object was thrown away";
      scene.run(180);
      EXPECT_LE(scene.distance(), 1e-4);
    }
  }
}

// The memory of all terms at once: a hand that presses on an object. Loading it undoes `restore`.
TEST(HandSimulation, LoadedMemoryKeepsContacts) {
  HandOverASphere scene(false);
  scene.simulation.set_slot_motion(scene.slot, {scene.place.position + Vector3(0, 4e-3, 0), Quaternion::Identity()},
                                   {});
  scene.run(5);
  const int contacts = scene.simulation.contact_count();
  ASSERT_GT(contacts, 0);
  std::vector<std::byte> bytes(4'000'000);
  ByteWriter out(bytes);
  scene.simulation.save(out);
  ASSERT_FALSE(out.overflowed());
  const State state = scene.simulation.state();
  scene.simulation.restore(state);
  EXPECT_EQ(scene.simulation.contact_count(), 0);
  ByteReader in(out.written());
  scene.simulation.load(in);
  EXPECT_TRUE(in.rest().empty());
  EXPECT_EQ(scene.simulation.contact_count(), contacts);
  std::vector<std::byte> again(bytes.size());
  ByteWriter second(again);
  scene.simulation.save(second);
  EXPECT_EQ(bytes, again);
}

// Tissue of the little finger is torn apart with more energy than a mirrored hand has. The palm touches a sphere.
TEST(Untangler, KeepsTheContactsOfOtherTissue) {
  const HandModel hand = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  HandOverASphere scene(false);
  State state = scene.simulation.state();
  const ShapeGeometry& sphere = scene.sphere;
  ContactSet contacts(hand, lumped_masses(hand), 1e7, kBodyCount, 1, 2);
  contacts.set_object(1, &sphere, 0.8, 7, ContactObject::fixed);
  state.body_poses[kBodyCount + 1] = {scene.place.position + Vector3(0, 4e-3, 0), Quaternion::Identity()};
  contacts.begin_step(state, kStep);
  contacts.end_step(state);
  const int count = contacts.count();
  ASSERT_GT(count, 0);
  testing::Random random(3);
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    if (static_cast<Body>(hand.node_body[n]) == Body::little_distal)
      state.node_positions.col(static_cast<Eigen::Index>(n)) += 0.2 * random.vector();
  }
  const Eigen::Matrix3Xd torn = state.node_positions;
  Tissue tissue(hand);
  SkeletonTissue attachments(hand, state.layout());
  Untangler untangler(hand, 0.1);
  EXPECT_GT(untangler.quick_check(state, &contacts, tissue, attachments), 0);
  EXPECT_EQ(contacts.count(), count);
  for (const ContactSet::Anchor& anchor : contacts.anchors()) {
    const std::int32_t node = contacts.points().main_node(anchor.point);
    EXPECT_EQ((state.node_positions.col(node) - torn.col(node)).norm(), 0);
  }
  EXPECT_GT((state.node_positions - torn).colwise().norm().maxCoeff(), 0.05);
}

// Only a small part of the hand is wrong: the skin of a fingertip is behind a thin plate. No tetrahedron is inverted.
TEST(HandSimulation, SkinHookedBehindAPlateRecovers) {
  HandModel hand = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  const ShapeGeometry plate(testing::box_shape({0.012, 0.002, 0.012}));
  const auto distance_after = [&](double period, std::uint64_t& untangled) {
    SimulationOptions o;
    o.untangle_patience = period;
    HandSimulation simulation(hand, o, 0, 1);
    set_rest_targets(simulation, {});
    const Eigen::Matrix3Xd rest = simulation.state().node_positions;
    Vector3 pad(0, 1, 0);
    for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
      if (static_cast<Body>(hand.node_body[n]) == Body::index_distal && hand.nodes[n].y() < pad.y())
        pad = hand.nodes[n];
    }
    simulation.set_slot(0, {7, &plate, 1, Matrix3::Identity(), 0.8});
    simulation.set_slot_motion(0, {pad - Vector3(0, 0.003, 0), Quaternion::Identity()}, {});
    State state = simulation.state();
    for (Eigen::Index n = 0; n < state.node_positions.cols(); ++n) {
      if ((rest.col(n) - pad).norm() < 6e-3) state.node_positions(1, n) = pad.y() - 5.5e-3;
    }
    simulation.restore(state);
    for (int i = 0; i < 90; ++i) simulation.step(kStep);
    untangled = simulation.untangled_nodes();
    return (simulation.state().node_positions - rest).colwise().norm().maxCoeff();
  };
  std::uint64_t untangled = 0;
  EXPECT_GT(distance_after(0, untangled), 2e-3) << "no skin is hooked: this test shows nothing";
  EXPECT_LT(distance_after(SimulationOptions{}.untangle_patience, untangled), 1e-4);
  EXPECT_GT(untangled, 0u);
}

TEST(HandSimulation, HasNoObjectTermsWithoutSlots) {
  HandSimulation simulation(hand(), options(), 0, 0);
  set_rest_targets(simulation, {});
  const StepReport report = simulation.step(kStep);
  for (std::size_t t = 0; t < report.term_count; ++t) {
    EXPECT_NE(report.terms[t].name, "contact");
    EXPECT_NE(report.terms[t].name, "friction");
    EXPECT_NE(report.terms[t].name, "plane_contact");
  }
}

TEST(HandSimulation, HandWithoutTissueEvaluatesNoTissue) {
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
  EXPECT_LE(worst_joint_error(simulation, wrist), 1e-4) << "the bones must still follow";
  EXPECT_EQ(simulation.work().tissue_elements, 0u);
  EXPECT_EQ(simulation.work().contact_queries, 0u);
}

TEST(HandSimulation, QueriesContactOnlyNearObjects) {
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
  simulation.set_slot_motion(0, {Vector3(-0.012, 0.0375, -0.164), Quaternion::Identity()}, {});  // touches a node
  simulation.step(kStep);
  const std::uint64_t near = simulation.work().contact_queries;
  EXPECT_GT(near, 0u);
  EXPECT_LT(near, 2u * static_cast<std::uint64_t>(simulation.hand().node_count())) << "only nearby bones are queried";
}

TEST(HandSimulation, ADynamicSlotFallsAndAKinematicOneStays) {
  SimulationOptions exact = options();
  exact.solver.factor = "double";
  HandSimulation simulation(hand(), exact, 2, 0);
  set_rest_targets(simulation, {});
  const ShapeGeometry geometry(cube_shape(0.02));
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

TEST(HandSimulation, ContactForceBalancesThePressOfTheHand) {
  // The palm's underside is pressed on a box from above. The contact force on the box must equal the couplings' push.
  HandSimulation simulation(hand(), options(), 1, 0);
  const ShapeGeometry geometry(cube_shape(0.02));
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
  EXPECT_NEAR(coupling.y(), wrench.force.y(), 0.02) << "the force of the couplings must reach the object";
}

SimulationOptions converging_options() {
  SimulationOptions o;
  o.solver.max_iterations = 60;
  o.solver.keep_factor = false;
  o.solver.factor = "double";
  o.solver.residual_tolerance = 1e-8;
  o.solver.movement_tolerance = 1e-10;
  o.solver.chord_tolerance = 0;
  return o;
}

const std::vector<Vector3> kCommonVelocities{{0, 0.3, 0}, {0, -0.3, 0}, {0, 3, 0}, {0, -3, 0},
                                             {0.3, 0, 0}, {3, 0, 0},    {0, 3, -3}};

// The hand presses the block for half a second and then drags it by 2 mm. All forces, including friction, are the same
// at every common velocity.
TEST(HandSimulation, CommonVelocityOfHandAndBlockChangesNoForce) {
  struct Run {
    std::vector<Vector3> forces;
    std::vector<Eigen::Matrix3Xd> nodes;
  };
  constexpr int kSteps = 90;
  const auto run = [](const Vector3& velocity) {
    testing::MovingTogether pair(velocity, 0.001, 0.004, converging_options());
    Run result;
    for (int i = 0; i < kSteps; ++i) {
      EXPECT_TRUE(pair.step(0.002 * std::clamp((i - 45) / 30.0, 0.0, 1.0)).state_changed);
      result.forces.push_back(pair.force());
      result.nodes.push_back(pair.nodes());
    }
    return result;
  };
  const Run resting = run(Vector3::Zero());
  ASSERT_LT(resting.forces.back().y(), -0.5);
  ASSERT_GT(std::abs(resting.forces.back().x()), 0.1) << "there must be friction";
  for (const Vector3& velocity : kCommonVelocities) {
    const Run moving = run(velocity);
    for (int i = 0; i < kSteps; ++i) {
      const auto k = static_cast<std::size_t>(i);
      SCOPED_TRACE(velocity.transpose());
      ASSERT_LE((moving.forces[k] - resting.forces[k]).norm(), 1e-4 * resting.forces.back().norm()) << "step " << i;
      ASSERT_LE((moving.nodes[k] - resting.nodes[k]).colwise().norm().maxCoeff(), 1e-7) << "step " << i;
    }
  }
}

TEST(HandSimulation, DistantBlockWithTheHandsVelocityDoesNotTouchTheHand) {
  for (const Vector3& velocity : {Vector3(0, 5, 0), Vector3(0, -5, 0), Vector3(5, 0, 0)}) {
    testing::MovingTogether pair(velocity, 0.010, 0, options());
    for (int i = 0; i < 45; ++i) {
      pair.step();
      ASSERT_EQ(pair.force(), Vector3::Zero()) << velocity.transpose() << ", step " << i;
      ASSERT_EQ(pair.simulation().contact_count(), 0) << velocity.transpose() << ", step " << i;
    }
  }
}

// The given pose holds at the start of the step. At the end of the step the object is where its velocity takes it.
TEST(HandSimulation, KinematicSlotMovesWithItsVelocity) {
  HandSimulation simulation(hand(), options(), 1, 1);
  set_rest_targets(simulation, {});
  const ShapeGeometry geometry(cube_shape(0.02));
  const Pose start{Vector3(3, 1, 0), rotation_exp(Vector3(0.1, 0.2, 0.3))};
  const Twist twist{Vector3(0.9, -1.8, 0), Vector3(0, 0, 4.5)};
  for (int slot = 0; slot < 2; ++slot) {
    simulation.set_slot(slot, {7, &geometry, 0.05, Matrix3::Identity() * 1.3e-5, 0.8});
    simulation.set_slot_motion(slot, start, twist);
  }
  for (int i = 0; i < 10; ++i) simulation.step(kStep);
  for (int slot = 0; slot < 2; ++slot) {
    const Pose expected = increment(start, 10 * kStep * twist.linear, 10 * kStep * twist.angular);
    EXPECT_LE((simulation.slot_pose(slot).position - expected.position).norm(), 1e-12);
    EXPECT_LE(rotation_log(simulation.slot_pose(slot).orientation * expected.orientation.conjugate()).norm(), 1e-12);
    EXPECT_EQ(simulation.slot_velocity(slot).linear, twist.linear);
  }
}

// Steps with a reused factor agree with steps with new factors: within 0.05 mm RMS and 1 % of the force.
/// The block factorisation. Stores the first matrix.
class Recording final : public LinearSolver {
 public:
  explicit Recording(BlockMatrix& first) : first_(first) {}
  void analyze(const BlockMatrix& matrix) override { sound_.analyze(matrix); }
  void load(const BlockMatrix& matrix) override {
    if (first_.stored_blocks() == 0) first_ = matrix;
    sound_.load(matrix);
  }
  bool factorize() override { return sound_.factorize(); }
  void solve(const VectorX& rhs, VectorX& x) override { sound_.solve(rhs, x); }

 private:
  BlockMatrix& first_;
  BlockCholesky<double> sound_;
};

// Products in float have an error of 1e-7 of the largest entry, and of 1e-3 if tissue is almost mirrored.
TEST(HandSimulation, ExactCurvatureIsExactWithAFloatFactor) {
  BlockMatrix matrices[2];
  for (const bool is_float : {false, true}) {
    SimulationOptions o = options();
    o.solver.curvature = "exact";
    o.solver.factor = is_float ? "float" : "double";
    o.solver.linear_solver = [&] { return std::make_unique<Recording>(matrices[is_float]); };
    HandSimulation simulation(hand(), o, 0, 0);
    set_rest_targets(simulation, {Vector3(0, -0.01, 0), Quaternion(Eigen::AngleAxisd(0.3, Vector3::UnitX()))});
    simulation.step(kStep);
  }
  ASSERT_GT(matrices[0].stored_blocks(), 0);
  double largest = 0, difference = 0;
  for (std::size_t i = 0; i < matrices[0].values().size(); ++i) {
    largest = std::max(largest, std::abs(matrices[0].values()[i]));
    difference = std::max(difference, std::abs(matrices[0].values()[i] - matrices[1].values()[i]));
  }
  EXPECT_EQ(difference / largest, 0);
}

TEST(HandSimulation, HoldsAnObjectAsWellWithAReusedFactor) {
  SimulationOptions reusing = options(), exact = options();
  exact.solver.keep_factor = false;
  exact.solver.residual_tolerance = 1e-9;
  exact.solver.factor = "double";
  HandSimulation quick(hand(), reusing, 1, 0), slow(hand(), exact, 1, 0);
  const ShapeGeometry geometry(cube_shape(0.02));
  for (HandSimulation* simulation : {&quick, &slow}) {
    simulation->set_slot(0, {7, &geometry, 0.05, Matrix3::Identity() * 1.3e-5, 0.8});
    simulation->set_slot_motion(0, {Vector3(-0.012, -0.018 - 0.02 - 0.001, -0.092), Quaternion::Identity()}, {});
  }
  int reused_steps = 0;
  for (int i = 0; i < 120; ++i) {
    const Pose pressed{Vector3(2e-4 * std::sin(0.3 * i), -0.004, 0), Quaternion::Identity()};
    set_rest_targets(quick, pressed);
    set_rest_targets(slow, pressed);
    const StepReport report = quick.step(kStep);
    slow.step(kStep);
    if (quick.touched(0)) reused_steps += report.factorisations == 0;
    ASSERT_LE((quick.state().node_positions - slow.state().node_positions).norm() /
                  std::sqrt(static_cast<double>(hand().node_count())),
              5e-5)
        << i;
    if (i > 30) {
      ASSERT_LE((quick.contact_wrench(0).force - slow.contact_wrench(0).force).norm(),
                0.01 * slow.contact_wrench(0).force.norm())
          << i;
    }
  }
  EXPECT_GE(reused_steps, 60);
}

TEST(HandSimulation, TwoThreadsGiveTheBitsOfOne) {
  if (testing::allowed_cores() < 2) GTEST_SKIP() << "one core";
  ASSERT_TRUE(HelperThread().present());
  SimulationOptions two = options();
  two.threads = 2;
  HandSimulation alone(hand(), options(), 1, 0), shared(hand(), two, 1, 0);
  const ShapeGeometry geometry(cube_shape(0.02));
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
  EXPECT_TRUE(alone.touched(0)) << "the run must include contact";
}

// The hand comes down on a box, drags it, and gives it back to the world. Then the hand is repositioned and comes back.
TEST(HandSimulation, EnergyLedgerCloses) {
  SimulationOptions exact = options();
  exact.solver.max_iterations = 30;
  exact.solver.residual_tolerance = 1e-8;
  exact.solver.chord_tolerance = 0;
  HandSimulation simulation(hand(), exact, 1, 0);
  simulation.enable_ledger(true);
  const ShapeGeometry geometry(cube_shape(0.02));
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
    const Pose wrist{
        Vector3(0.01 * std::sin(4 * t), i < 160 ? -0.005 * std::min(1.0, 3 * t) : 0.3 - 0.1 * (t - 160 * kStep), 0),
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
  simulation.enable_ledger(false);
  simulation.enable_ledger(true);
  EXPECT_FALSE(ledger.started());
}

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

// When the hand gives an object back, the world's copy may be decimetres from the twin. Treating this jump as a path
// through the hand gave a force of 21 kN.
TEST(HandSimulation, ObjectThatIsGivenBackIsNotSweptThroughTheHand) {
  const HandModel model = hand();
  HandSimulation simulation(model, {}, 1, 0);
  double low = 0, high = 0;
  for (const Vector3& node : model.nodes) {
    low = std::min(low, node.y());
    high = std::max(high, node.y());
  }
  const ShapeGeometry ball(testing::sphere_shape(0.05));
  MirroredObject object;
  object.id = 1;
  object.shape = &ball;
  simulation.set_slot(0, object);
  simulation.set_slot_motion(0, {Vector3(0, low - 0.06, -0.1), Quaternion::Identity()}, {});
  simulation.make_dynamic(0, Vector3::Zero());
  simulation.step(1.0 / 90);
  ASSERT_EQ(simulation.contact_count(), 0);
  simulation.make_kinematic(0);
  simulation.set_slot_motion(0, {Vector3(0, high + 0.06, -0.1), Quaternion::Identity()}, {});
  simulation.step(1.0 / 90);
  EXPECT_EQ(simulation.contact_count(), 0);
}

}  // namespace
}  // namespace softhand
