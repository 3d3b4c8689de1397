// Tissue that is inverted, twisted or collapsed, and skin on the wrong side of an object: the hand recovers.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <vector>

#include "energies/contact.hpp"
#include "energies/memory.hpp"
#include "energies/skeleton_tissue.hpp"
#include "energies/tissue.hpp"
#include "math/rotation.hpp"
#include "scene/rest_error.hpp"
#include "support/shapes.hpp"
#include "unit/hand_simulation_rig.hpp"

namespace softhand::untangling_test {
namespace {

using testing::hand;
using testing::index;
using testing::kStep;
using testing::options;
using testing::set_rest_targets;

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
  const std::array<const Energy*, 2> energies{&tissue, &attachments};
  for (double distance = 0.1; distance > 1e-3; distance *= 0.7) {
    State tangled = rest;
    tangled.node_positions.col(0) += distance * Vector3(0.48, 0.6, 0.64);
    Untangler first(model, 0.1), loaded(model, 0.1), fresh(model, 0.1);
    if (first.full_check(tangled, nullptr, 0, tissue, energies) > 0) continue;  // so much energy is put back at once
    loaded.load(first.save());
    State one = tangled, two = tangled, three = tangled;
    const int moved = first.full_check(one, nullptr, 0, tissue, energies);
    if (moved == 0) continue;
    EXPECT_EQ(loaded.full_check(two, nullptr, 0, tissue, energies), moved);
    EXPECT_EQ((one.node_positions - two.node_positions).cwiseAbs().maxCoeff(), 0);
    EXPECT_EQ(loaded.save().tangled, first.save().tangled);
    EXPECT_EQ(loaded.save().wait, first.save().wait);
    EXPECT_EQ(fresh.full_check(three, nullptr, 0, tissue, energies), 0);
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
      for (const SkinPoint& point : hand.contact_points)
        nearest = std::min(nearest, sphere.signed_distance(place.inverse() * hand.position_of(point)));
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
  scene.simulation.set_slot_motion(scene.slot, {scene.place.position + Vector3(0, 6e-3, 0), Quaternion::Identity()},
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
  state.body_poses[kBodyCount + 1] = {scene.place.position + Vector3(0, 6e-3, 0), Quaternion::Identity()};
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
  const std::array<const Energy*, 2> energies{&tissue, &attachments};
  Untangler untangler(hand, 0.1);
  EXPECT_GT(untangler.quick_check(state, &contacts, tissue, energies), 0);
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
      if ((rest.col(n) - pad).norm() < 6e-3) state.node_positions(1, n) = pad.y() - 8e-3;
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

}  // namespace
}  // namespace softhand::untangling_test
