// Two hands in one simulation: skin against skin, an object between them, and that far hands do nothing to each other.
#include "support/two_hands.hpp"

#include <gtest/gtest.h>

#include "messages/plain_bytes.hpp"
#include "scene/skin_traction.hpp"
#include "support/block_hand.hpp"
#include "support/cores.hpp"
#include "support/count_allocations.hpp"
#include "support/shapes.hpp"

namespace softhand::two_hands_test {
namespace {

using testing::PalmToPalm;

constexpr double kStep = 1.0 / 90;

const HandModel& right() {
  static const HandModel model = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  return model;
}

SimulationOptions exact() {
  SimulationOptions o;
  o.solver.residual_tolerance = 1e-7;
  o.solver.movement_tolerance = 1e-10;
  o.solver.increment_tolerance = 1e-13;
  o.solver.max_iterations = 200;
  o.solver.chord_tolerance = 0;
  return o;
}

// Hands that approach, press by 7 mm, and part again.
double closer_at(int step) {
  return step < 45 ? 0.017 * std::min(1.0, step / 20.0) : 0.017 - 0.02 * (step - 45) / 20.0;
}

constexpr int kClapSteps = 75;
constexpr double kGap = 0.01;

TEST(TwoHandsInOneSimulation, ClapConservesMomentum) {
  PalmToPalm hands(testing::block_hand(), exact(), 0.004);
  hands.throw_hand(1, Vector3(0.1, 1, 0.05));
  const Vector3 before = hands.momentum(0) + hands.momentum(1);
  ASSERT_EQ(hands.momentum(0).norm(), 0);
  double largest = 0;
  for (int i = 0; i < 40; ++i) {
    ASSERT_TRUE(hands.simulation.step(1e-3).state_changed);
    largest = std::max(largest, hands.force_on(0).norm());
    EXPECT_LE((hands.force_on(0) + hands.force_on(1)).norm(), 1e-9 * std::max(1.0, largest));
  }
  EXPECT_GT(largest, 1) << "the hands did not meet";
  EXPECT_GT(hands.momentum(0).norm(), 0.2 * before.norm()) << "the hands did not push each other";
  EXPECT_LE((hands.momentum(0) + hands.momentum(1) - before).norm(), 1e-8 * before.norm());
}

TEST(TwoHandsInOneSimulation, PalmsPressAndPartAgain) {
  SimulationOptions options = exact();
  options.solver.residual_tolerance = 1e-4;
  options.solver.movement_tolerance = 1e-7;
  options.solver.max_iterations = 30;
  PalmToPalm hands(right(), options, kGap);
  HandSimulation& simulation = hands.simulation;
  simulation.enable_ledger(true);
  double pressed = 0, deepest = 0;
  for (int i = 0; i < kClapSteps; ++i) {
    hands.aim(closer_at(i));
    ASSERT_TRUE(simulation.step(kStep).state_changed);
    pressed = std::max(pressed, -hands.force_on(1).y());
    deepest = std::max(deepest, simulation.skin_between()->deepest_penetration(simulation.state()));
    // The skin of each hand feels the other hand.
    for (int hand = 0; hand < 2; ++hand) {
      Vector3 on_bones = Vector3::Zero();
      for (const Vector3& force : simulation.bone_contact_forces(hand)) on_bones += force;
      ASSERT_LE((on_bones - hands.force_on(hand)).norm(), 1e-9) << i;
    }
  }
  EXPECT_GT(pressed, 2);
  EXPECT_LE(deepest, 2e-3);
  EXPECT_TRUE(simulation.skin_between()->anchors().empty()) << "the hands still touch each other";
  EXPECT_EQ(simulation.inverted_elements(), 0);
  EXPECT_LE(simulation.ledger().defect(), 0.01);
  EXPECT_LE(simulation.ledger().excess(), 0.01);
}

// Each hand is as it would be alone, up to the tolerance of the solver. Both end their iterations together, so in each
// step both cost twice what the hand with more iterations costs alone.
TEST(TwoHandsInOneSimulation, FarHandsDoNothingToEachOther) {
  SimulationOptions options;
  options.solver.residual_tolerance = 1e-6;
  options.solver.movement_tolerance = 1e-9;
  options.solver.chord_tolerance = 0;
  PalmToPalm both(right(), options, 0.5);
  HandSimulation alone(right(), options, 0, 0), other(mirrored(right()), options, 0, 0);
  alone.reposition(both.wrist(0));
  other.reposition(both.wrist(1));
  std::uint64_t dearer = 0;  // elements of the hand that has more of them, summed over the steps
  for (int i = 0; i < 40; ++i) {
    const double closer = 0.05 * std::sin(3 * i * kStep);
    both.aim(closer);
    for (int b = 0; b < kBodyCount; ++b) {
      const Body body = static_cast<Body>(b);
      const auto joint = static_cast<std::size_t>(index_of(joint_of(body)));
      Pose above = both.wrist(0), below = both.wrist(1);
      above.position.y() -= 0.5 * closer;
      below.position.y() += 0.5 * closer;
      alone.set_target(body, above * alone.hand().rest_joints[joint], {});
      other.set_target(body, below * other.hand().rest_joints[joint], {});
    }
    const std::uint64_t alone_before = alone.work().tissue_elements, other_before = other.work().tissue_elements;
    for (HandSimulation* each : {&both.simulation, &alone, &other}) ASSERT_TRUE(each->step(kStep).state_changed);
    dearer += std::max(alone.work().tissue_elements - alone_before, other.work().tissue_elements - other_before);
    const Eigen::Matrix3Xd& nodes = both.simulation.state().node_positions;
    const Eigen::Index count = right().node_count();
    EXPECT_LE((nodes.leftCols(count) - alone.state().node_positions).cwiseAbs().maxCoeff(), 1e-7) << i;
    EXPECT_LE((nodes.rightCols(count) - other.state().node_positions).cwiseAbs().maxCoeff(), 1e-7) << i;
  }
  EXPECT_EQ(both.simulation.work().skin_queries, 0u);
  EXPECT_LE(both.simulation.work().skin_part_queries, 40u * 36u) << "36 pairs of parts of two hands";
  EXPECT_EQ(both.simulation.work().tissue_elements, 2 * dearer);
}

TEST(TwoHandsInOneSimulation, TwoThreadsAndASavedStateGiveTheSameBits) {
  SimulationOptions one;
  one.skin_contact = true;  // with all terms
  SimulationOptions two = one;
  two.threads = testing::allowed_cores() < 2 ? 1 : 2;
  PalmToPalm first(right(), one, kGap), second(right(), two, kGap), loaded(right(), one, kGap);
  const auto expect_equal = [](const HandSimulation& a, const HandSimulation& b, int step) {
    ASSERT_EQ(a.state().node_positions, b.state().node_positions) << step;
    ASSERT_EQ(a.state().node_velocities, b.state().node_velocities) << step;
  };
  for (int i = 0; i < 40; ++i) {
    for (PalmToPalm* hands : {&first, &second}) {
      hands->aim(closer_at(i));
      hands->simulation.step(kStep);
    }
    expect_equal(first.simulation, second.simulation, i);
  }
  ASSERT_FALSE(first.simulation.skin_between()->anchors().empty());
  std::vector<std::byte> bytes(8 << 20);
  ByteWriter out(bytes);
  first.simulation.save(out);
  ASSERT_FALSE(out.overflowed());
  first.simulation.forget();
  bytes.resize(out.size());
  ByteReader in(bytes);
  loaded.simulation.load(in);
  second.simulation.take_state(first.simulation);
  for (int i = 40; i < 50; ++i) {
    for (PalmToPalm* hands : {&first, &second, &loaded}) {
      hands->aim(closer_at(i));
      hands->simulation.step(kStep);
    }
    expect_equal(first.simulation, loaded.simulation, i);
    expect_equal(first.simulation, second.simulation, i);
  }
}

#ifdef SOFTHAND_COUNT_MALLOC
TEST(TwoHandsInOneSimulation, StepsDoNotAllocate) {
  PalmToPalm hands(right(), {}, kGap);
  for (const bool counts : {false, true}) {
    for (int i = 0; i < kClapSteps; ++i) {
      hands.aim(closer_at(i));
      allocations = 0;
      counting = counts;
      hands.simulation.step(kStep);
      counting = false;
      ASSERT_EQ(allocations, 0) << i;
    }
  }
}
#endif

// Both hands press a box of 0.3 kg from above and below, and shake it aside. It is one body of one implicit system.
TEST(TwoHandsInOneSimulation, HoldABoxTogether) {
  constexpr double kMass = 0.3, kHalf = 0.02;
  PalmToPalm hands(testing::block_hand(), {}, 2 * kHalf + 0.0005, 1);
  HandSimulation& simulation = hands.simulation;
  const ShapeGeometry shape(testing::box_shape({0.03, kHalf, 0.03}));
  simulation.set_slot(0, {.id = 5,
                          .shape = &shape,
                          .mass = kMass,
                          .inertia = kMass / 3 * Vector3(1.3e-3, 1.8e-3, 1.3e-3).asDiagonal(),
                          .friction = 0.8});
  simulation.set_slot_motion(0, {.position = {-0.03, 0, -0.09}}, {});
  simulation.make_dynamic(0, {0, -9.81, 0});
  constexpr int kSteps = 180, kMeasured = 45;
  Vector3 force = Vector3::Zero();
  std::array<Vector3, 2> of_hand{Vector3::Zero(), Vector3::Zero()};
  for (int i = 0; i < kSteps; ++i) {
    hands.aim(0.01);
    ASSERT_TRUE(simulation.step(kStep).state_changed);
    if (i < kSteps - kMeasured) continue;
    force += simulation.contact_wrench(0).force / kMeasured;
    for (int hand = 0; hand < 2; ++hand) {
      auto contacts = std::make_unique<Contacts>();
      simulation.write_contacts(*contacts, hand);
      for (const Contact& contact : contacts->contacts) {
        EXPECT_EQ(contact.object, 5u);
        EXPECT_LT(contact.node, static_cast<std::uint32_t>(simulation.hand().node_count()));
        EXPECT_LT(contact.body, static_cast<std::uint32_t>(kBodyCount));
        of_hand[static_cast<std::size_t>(hand)] -=
            Vector3(contact.force[0], contact.force[1], contact.force[2]) / kMeasured;
      }
    }
  }
  EXPECT_NEAR(force.y() / (kMass * 9.81), 1, 0.01);
  EXPECT_LE((of_hand[0] + of_hand[1] - force).norm(), 1e-9);
  EXPECT_LT(of_hand[0].y(), -1) << "the upper hand presses down";
  EXPECT_GT(of_hand[1].y(), kMass * 9.81 + 1) << "the lower hand carries the box and the upper hand";
}

// What tactile devices get of the other hand sums to its force.
TEST(TwoHandsInOneSimulation, TractionOfEachHandIsTheForceOfTheOther) {
  PalmToPalm hands(right(), {}, kGap);
  const HandSimulation& simulation = hands.simulation;
  for (int i = 0; i < 40; ++i) {
    hands.aim(closer_at(i));
    hands.simulation.step(kStep);
  }
  ASSERT_FALSE(simulation.skin_between()->anchors().empty());
  for (int hand = 0; hand < 2; ++hand) {
    SkinTractionReport report(simulation.hand(hand), simulation.first_node(hand), simulation.first_body(hand));
    auto traction = std::make_unique<SkinTraction>();
    simulation.write_traction(kStep, report, *traction, hand);
    Vector3 sum = Vector3::Zero();
    for (const SkinRegion& region : traction->regions) {
      const Vector3 normal(region.normal[0], region.normal[1], region.normal[2]);
      const Vector3 shear(region.shear[0], region.shear[1], region.shear[2]);
      const Pose joint = simulation.joint_pose(joint_of(static_cast<Body>(region.body)), hand);
      sum += joint.orientation * Vector3(region.area * (shear - region.pressure * normal));
      EXPECT_EQ(region.object, 0u);
    }
    EXPECT_LE((sum - hands.force_on(hand)).norm(), 1e-3 * hands.force_on(hand).norm());
  }
}

// The hands start 6 mm inside each other. They move apart at the speed of the anchors (0.75 m/s), without
// a bang.
TEST(TwoHandsInOneSimulation, HandsThatStartInsideEachOtherComeApart) {
  PalmToPalm hands(right(), {}, -0.006);
  HandSimulation& simulation = hands.simulation;
  double fastest = 0;
  for (int i = 0; i < 90; ++i) {
    hands.aim(i < 45 ? 0.0 : -0.02);
    ASSERT_TRUE(simulation.step(kStep).state_changed);
    fastest = std::max(fastest, simulation.state().node_velocities.colwise().norm().maxCoeff());
    if (i == 0) {
      EXPECT_FALSE(simulation.skin_between()->anchors().empty());
    }
  }
  EXPECT_LT(fastest, 2);
  EXPECT_TRUE(simulation.skin_between()->anchors().empty());
  EXPECT_EQ(simulation.inverted_elements(), 0);
}

}  // namespace
}  // namespace softhand::two_hands_test
