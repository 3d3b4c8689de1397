// The judge of flexible objects, with generated messages whose results are known.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/outcome.hpp"
#include "cli/soft_outcome.hpp"
#include "messages/convert.hpp"
#include "support/soft_bodies.hpp"

namespace softhand::cli_soft_outcome_test {
namespace {

using Json = nlohmann::ordered_json;

constexpr Nanoseconds kStart = 5'000'000'000;

Nanoseconds at(double t) { return kStart + static_cast<Nanoseconds>(std::llround(t * 1e9)); }

// A cube of 40 mm whose width along x changes with time: 1 to 0.4 at 1 s and back. The motion ends at 2 s.
struct SqueezedCube {
  std::shared_ptr<const SoftBody> body =
      testing::soft_box({2, 2, 2}, Vector3::Constant(0.04), testing::soft_material(1e4));
  SoftOutcome outcome{*body};

  SoftObjectState state(double t, double width, std::uint32_t contacts) const {
    SoftObjectState out;
    out.object = kFirstSoftObject;
    out.stamp.sample_time = at(t);
    out.contact_count = contacts;
    for (const Vector3& node : body->nodes)
      out.nodes.push_back(to_floats(Vector3(width * node.x(), node.y(), node.z())));
    return out;
  }
  void play(double last_width) {
    for (int i = 0; i <= 40; ++i) {
      const double t = 0.05 * i, bend = std::abs(t - 1);
      outcome.on_state(state(t, std::max(0.4, t < 1 ? 0.4 + 0.6 * bend : 0.4 + (last_width - 0.4) * bend), t < 1.8));
    }
  }
  Json judge(const SoftGoal& goal) const {
    OutcomeFrame frame;
    frame.motion_start = kStart;
    frame.phases = {{"squeeze", 0, 2}};
    return outcome.summary(goal, frame);
  }
};

TEST(SoftOutcome, MeasuresHowFarAnObjectWasSqueezedAndHowItRecovers) {
  SqueezedCube cube;
  cube.play(0.99);
  // The tracker begins again: not judged.
  cube.outcome.on_state(cube.state(2.8, 0.1, 3));
  const Json json = cube.judge({.squeezed = 0.5, .recovers = 0.02});
  // No line through the middle is exactly along x: the nearest one is 3 degrees off.
  EXPECT_NEAR(json["squeezed_to_fraction"].get<double>(), 0.4, 0.02);
  EXPECT_NEAR(json["least_width_first_mm"].get<double>(), 40, 1);
  EXPECT_LT(json["end_off_fraction"].get<double>(), 0.012);
  EXPECT_EQ(json["contacts_max"], 1);
  EXPECT_EQ(json["success"], true) << json["success_because"];
  EXPECT_EQ(cube.judge({.squeezed = 0.3})["success"], false);
}

// A block of 3 x 3 x 3 cells without the two upper ones in the middle: upwards, lines from its centre meet nothing.
TEST(SoftOutcome, LinesThroughAnOpeningAreNoWidths) {
  auto cup =
      std::make_shared<SoftBody>(*testing::soft_box({3, 3, 3}, Vector3::Constant(0.03), testing::soft_material(1e4)));
  std::erase_if(cup->tetrahedra, [&](const auto& tetrahedron) {
    Vector3 middle = Vector3::Zero();
    for (const auto corner : tetrahedron) middle += 0.25 * cup->nodes[static_cast<std::size_t>(corner)];
    return std::abs(middle.x()) < 0.005 && std::abs(middle.z()) < 0.005 && middle.y() > -0.005;
  });
  SoftOutcome outcome(*cup);
  SoftObjectState state;
  state.object = kFirstSoftObject;
  state.stamp.sample_time = kStart;
  for (const Vector3& node : cup->nodes) state.nodes.push_back(to_floats(node));
  outcome.on_state(state);
  const Json json = outcome.summary({}, OutcomeFrame{});
  EXPECT_NEAR(json["least_width_first_mm"].get<double>(), 30, 1);
}

TEST(SoftOutcome, JudgesTheLiftAndTheWidthUntilTheSqueeze) {
  SqueezedCube cube;
  for (int i = 0; i <= 40; ++i) {
    const double t = 0.05 * i;  // lifted from 0 s on, lowered from 1 s on, and squeezed from 1.5 s on
    SoftObjectState state = cube.state(t, t > 1.5 ? 0.5 : t > 1 ? 0.9 : 0.95, 1);
    state.centre = {0, t < 1 ? 0.05 * t : 0, 0};
    if (i == 0) state = cube.state(t, 1, 0);
    cube.outcome.on_state(state);
    Contacts contacts;
    contacts.stamp.sample_time = at(t);
    contacts.contacts.push_back({.object = kFirstSoftObject, .force = {0, 0, 1}});
    contacts.fingers[0] = {.force = {0, 0, t < 1 ? 1.0 : 8.0}, .object = kFirstSoftObject};
    contacts.fingers[1] = {.force = {0, 0, 20}, .object = 3};
    cube.outcome.on_contacts(contacts);
  }
  const auto judged = [&](const SoftGoal& goal) {
    OutcomeFrame frame;
    frame.motion_start = kStart;
    frame.phases = {{"lift", 0, 0.5}, {"hold", 0.5, 1}, {"lower", 1, 1.5}, {"squeeze", 1.5, 2}};
    return cube.outcome.summary(goal, frame);
  };
  const Json json = judged({.lifted = 0.045, .kept = 0.85, .squeezed = 0.55});
  EXPECT_EQ(json["success"], true) << json["success_because"];
  EXPECT_NEAR(json["lifted_mm"].get<double>(), 47.5, 1e-9);
  EXPECT_NEAR(json["kept_fraction"].get<double>(), 0.9, 0.01);
  EXPECT_DOUBLE_EQ(json["held_force_n"].get<double>(), 1);
  EXPECT_DOUBLE_EQ(json["finger_force_max_n"].get<double>(), 8);
  EXPECT_EQ(judged({.lifted = 0.05})["success"], false);
  EXPECT_EQ(judged({.kept = 0.92})["success"], false);
}

TEST(SoftOutcome, AnObjectThatStaysFlatHasNotRecovered) {
  SqueezedCube cube;
  cube.play(0.9);
  EXPECT_EQ(cube.judge({.recovers = 0.02})["success"], false);
}

TEST(SoftOutcome, RefusesNumbersThatAreNotFiniteAndOtherObjects) {
  SqueezedCube cube;
  cube.play(1);
  SoftObjectState bad = cube.state(1, 1, 1);
  bad.nodes[3][1] = std::numeric_limits<float>::quiet_NaN();
  cube.outcome.on_state(bad);
  bad = cube.state(1, 1, 1);
  bad.nodes.count = 5;
  cube.outcome.on_state(bad);
  bad = cube.state(1, 0, 1);
  bad.object = kFirstSoftObject + 1;
  cube.outcome.on_state(bad);
  const Json json = cube.judge({.squeezed = 0.5});
  EXPECT_EQ(json["refused_states"], 2);
  EXPECT_NEAR(json["squeezed_to_fraction"].get<double>(), 0.4, 0.02);
}

TEST(SoftOutcome, WithoutAMessageAGoalIsMissed) {
  const SqueezedCube cube;
  EXPECT_EQ(cube.judge({.squeezed = 0.5})["success"], false);
  EXPECT_FALSE(cube.judge({}).contains("success"));
}

}  // namespace
}  // namespace softhand::cli_soft_outcome_test
