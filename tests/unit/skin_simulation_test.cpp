// Contact of the skin with itself in the whole hand: a fist that closes and opens.
#include <gtest/gtest.h>

#include "contact/skin_patches.hpp"
#include "energies/skin_contact.hpp"
#include "messages/plain_bytes.hpp"
#include "scene/finger_gap.hpp"
#include "scene/hand_simulation.hpp"
#include "support/cores.hpp"
#include "support/count_allocations.hpp"
#include "trackers/replay/generator.hpp"

namespace softhand::skin_simulation_test {
namespace {

constexpr double kStep = 1.0 / 90;
constexpr double kClosed = 2.0;  // s; the generated fist is closed
constexpr double kEnd = 4.0;     // and open again

const HandModel& hand() {
  static const HandModel model = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  return model;
}

const Motion& fist() {
  static const std::unique_ptr<Motion> motion = [] {
    GeneratorOptions options;
    options.motion = "fist";
    options.object_position = {0, 0, 0};
    return make_motion(hand(), options);
  }();
  return *motion;
}

SimulationOptions options(bool skin_contact = true) {
  SimulationOptions o;
  o.skin_contact = skin_contact;
  return o;
}

// While the fist is closed, the thumb is pressed onto the index finger: by up to `press` metres.
void aim(HandSimulation& simulation, double time, double press = 0) {
  const JointFrames frames = fist().at(time);
  const double closed = std::max(0.0, 1 - std::abs(time / kClosed - 1) / 0.25);
  const auto place = [&](Joint joint) { return frames[static_cast<std::size_t>(index_of(joint))].position; };
  const Vector3 inward = (place(Joint::index_intermediate) - place(Joint::thumb_distal)).normalized();
  for (int b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    Pose target = frames[static_cast<std::size_t>(index_of(joint_of(body)))];
    if (finger_of(body) == Finger::thumb && !is_metacarpal(body)) target.position += press * closed * inward;
    simulation.set_target(body, target, {});
  }
}

// Steps from `from` to `to` seconds of the motion and calls after(simulation) after each step.
template <typename After>
void play(HandSimulation& simulation, double from, double to, After&& after, double press = 0) {
  for (double time = from; time < to; time += kStep) {
    aim(simulation, time, press);
    ASSERT_TRUE(simulation.step(kStep).state_changed);
    after(simulation);
  }
}

TEST(SkinOfAHand, FistHoldsItsFingersApart) {
  constexpr double kPress = 12e-3;  // m
  double gaps[2];
  for (const bool contact : {false, true}) {
    HandSimulation simulation(hand(), options(contact), 0, 0);
    double gap = 1;
    std::vector<double> depths;
    const auto after = [&](const HandSimulation& s) {
      gap = std::min(gap, finger_gap(s.hand(), s.state()));
      if (s.skin() == nullptr) return;
      for (const SkinAnchor& anchor : s.skin()->anchors())
        depths.push_back(std::max(0.0, -s.skin()->offset(anchor, s.state()).depth));
    };
    play(simulation, 0, kEnd, after, kPress);
    gaps[contact ? 1 : 0] = gap;
    EXPECT_EQ(simulation.skin() != nullptr, contact);
    EXPECT_EQ(simulation.work().skin_part_queries > 0, contact);
    EXPECT_EQ(simulation.inverted_elements(), 0);
    if (!contact) continue;
    ASSERT_GT(depths.size(), 1000u);
    std::sort(depths.begin(), depths.end());
    EXPECT_LE(depths[depths.size() * 95 / 100], 0.5e-3);
    EXPECT_TRUE(simulation.skin()->anchors().empty()) << "the open hand still touches itself";
  }
  std::printf("  %.1f mm with contact, %.1f mm without\n", gaps[1] * 1e3, gaps[0] * 1e3);
  EXPECT_GT(gaps[1], gaps[0] + 1e-3);
}

// On the coarse mesh the thumb touched its own root: a nearer node, far along the skin, gave a point its patch.
TEST(SkinOfAHand, NoPointCanTouchTheTriangleThatItLiesOn) {
  for (const char* const name : {"right_400", "right_750", "right_1450", "right_3000", "right_6000"}) {
    const HandModel model = load_hand(std::string(SOFTHAND_SOURCE_DIR "/config/hands/") + name + ".hand.json");
    const ContactPoints points(model, lumped_masses(model));
    const SkinPatches patches(model, points);
    int found = 0;
    for (int point = 0; point < points.count(); ++point) {
      const auto nodes = points.nodes(point);
      for (const std::int32_t triangle : patches.triangles_around(nodes[0])) {
        const auto& corners = model.surface[static_cast<std::size_t>(triangle)];
        if (std::ranges::any_of(nodes, [&](auto node) { return std::ranges::find(corners, node) == corners.end(); }))
          continue;
        ++found;
        EXPECT_FALSE(patches.can_touch(patches.patch_of_point(point), patches.patch_of_triangle(triangle)))
            << name << ": point " << point << ", triangle " << triangle;
      }
    }
    EXPECT_GE(found, points.count()) << name;
  }
}

// The open hand has no narrow query, and its chord steps stay: the term costs the queries of the parts only.
TEST(SkinOfAHand, OpenHandCostsOnlyTheQueriesOfItsParts) {
  const HandModel fine = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_1450.hand.json");
  HandSimulation with(fine, options(), 0, 0), without(fine, options(false), 0, 0);
  std::uint64_t queries = 0;
  for (int i = 0; i < 40; ++i) {
    JointFrames frames = fine.rest_joints;
    for (Pose& frame : frames) frame.position += Vector3(0, 0.05 * std::sin(3 * i * kStep), 0);
    for (HandSimulation* simulation : {&with, &without}) {
      for (int b = 0; b < kBodyCount; ++b) {
        const Body body = static_cast<Body>(b);
        simulation->set_target(body, frames[static_cast<std::size_t>(index_of(joint_of(body)))], {});
      }
      simulation->step(kStep);
    }
    if (i == 0) queries = with.work().skin_queries;  // the first step looks for skin that is deep inside
    ASSERT_EQ(with.state().node_positions, without.state().node_positions) << i;
  }
  EXPECT_EQ(with.work().skin_queries, queries);
  EXPECT_LE(with.work().skin_part_queries, 40u * 15u) << "15 pairs of parts";
  EXPECT_EQ(with.work().factorised_steps, without.work().factorised_steps);
}

TEST(SkinOfAHand, TwoThreadsAndTwoRunsGiveTheSameBits) {
  SimulationOptions two = options();
  two.threads = testing::allowed_cores() < 2 ? 1 : 2;
  HandSimulation first(hand(), options(), 0, 0), second(hand(), two, 0, 0);
  bool touched = false;
  for (double time = 1; time < kClosed + 0.3; time += kStep) {
    for (HandSimulation* simulation : {&first, &second}) {
      aim(*simulation, time);
      simulation->step(kStep);
    }
    touched = touched || !first.skin()->anchors().empty();
    ASSERT_EQ(first.state().node_positions, second.state().node_positions) << time;
    ASSERT_EQ(first.state().node_velocities, second.state().node_velocities) << time;
  }
  EXPECT_TRUE(touched);
}

TEST(SkinOfAHand, SavedStateContinuesWithTheSameBits) {
  HandSimulation first(hand(), options(), 0, 0), second(hand(), options(), 0, 0);
  play(first, 1, kClosed, [](const HandSimulation&) {});
  ASSERT_FALSE(first.skin()->anchors().empty());
  std::vector<std::byte> bytes(8 << 20);
  ByteWriter out(bytes);
  first.save(out);
  ASSERT_FALSE(out.overflowed());
  first.forget();
  bytes.resize(out.size());
  ByteReader in(bytes);
  second.load(in);
  for (double time = kClosed; time < kClosed + 0.2; time += kStep) {
    for (HandSimulation* simulation : {&first, &second}) {
      aim(*simulation, time);
      simulation->step(kStep);
    }
    ASSERT_EQ(first.state().node_positions, second.state().node_positions);
  }
}

#ifdef SOFTHAND_COUNT_MALLOC
TEST(SkinOfAHand, StepsDoNotAllocate) {
  HandSimulation simulation(hand(), options(), 0, 0);
  play(simulation, 0, kEnd, [](const HandSimulation&) {});
  for (double time = 0; time < kEnd; time += kStep) {
    aim(simulation, time);
    allocations = 0;
    counting = true;
    simulation.step(kStep);
    counting = false;
    ASSERT_EQ(allocations, 0) << time;
  }
}
#endif

// A closed fist is in balance: the forces of the skin on itself sum to zero, and the ledger closes.
TEST(SkinOfAHand, ForcesSumToZeroAndTheLedgerCloses) {
  SimulationOptions exact = options();
  exact.solver.residual_tolerance = 1e-6;
  HandSimulation simulation(hand(), exact, 0, 0);
  simulation.enable_ledger(true);
  double largest = 0;
  play(simulation, 0, kEnd, [&](const HandSimulation& s) {
    Vector3 sum = Vector3::Zero();
    for (const Vector3& force : s.bone_contact_forces()) {
      sum += force;
      largest = std::max(largest, force.norm());
    }
    EXPECT_LE(sum.norm(), 1e-9);
  });
  EXPECT_GT(largest, 0.5);
  EXPECT_LE(simulation.ledger().defect(), 0.01);
  EXPECT_LE(simulation.ledger().excess(), 0.01);
  EXPECT_GT(simulation.ledger().total().friction, 0.0);
}

}  // namespace
}  // namespace softhand::skin_simulation_test
