// Contact between bones: derivatives, balance, a known answer, and which bones touch.
#include "energies/skeleton_contact.hpp"

#include <gtest/gtest.h>

#include "energies/derivative_suite.hpp"
#include "model/kinematics.hpp"

namespace softhand::skeleton_contact_test {
namespace {

constexpr DofLayout kTwoBones{1, 2};

BoneCapsule bone(int body, double radius) {
  return {static_cast<Finger>(body), false, body, {0.001, 0.002, 0.018}, {-0.001, 0, -0.012}, radius};
}

// The middles of both axes are `apart`, and the second bone is turned by `turn`.
State placed(const Vector3& apart, const Vector3& turn) {
  State state = testing::random_state(kTwoBones, 3);
  const Vector3 middle(0, 0.001, 0.003);
  state.body_poses[1].orientation = rotation_exp(turn) * state.body_poses[0].orientation;
  state.body_poses[1].position =
      state.body_poses[0] * Vector3(middle + apart) - state.body_poses[1].orientation * middle;
  return state;
}

TEST(SkeletonContact, DerivativesAndBalanceAndRigidMotion) {
  SkeletonContact term({{bone(0, 0.004), bone(1, 0.003)}}, true, kTwoBones);
  const std::pair<Vector3, Vector3> placements[]{
      {{0.006, 0, 0.001}, {0, 0, 0.01}},      // side by side
      {{0.006, 0, 0.001}, {1.3, 0.4, -0.2}},  // across
      {{0.002, 0.001, 0}, {1.3, 0.4, -0.2}},  // nearly through each other
      {{0.005, 0.001, 0.02}, {0.1, 0.2, 3}},  // one is halfway beside the other
      {{0, -0.002, 0.033}, {0.1, 0.1, 0}}};   // end to end
  for (const auto& [apart, turn] : placements) {
    const State state = placed(apart, turn);
    testing::check_term(term, state, 0.01, {.step = 1e-6, .tolerance = 1e-5});
    testing::check_balance(term, state);
    testing::check_rigid_motion(term, state, {Vector3(1, -2, 0.5), rotation_exp(Vector3(2, 1, -1))});
  }
}

TEST(SkeletonContact, AxesThatCrossHaveAFiniteForce) {
  SkeletonContact term({{bone(0, 0.004), bone(1, 0.003)}}, true, kTwoBones);
  const State state = placed(Vector3::Zero(), Vector3::Zero());
  testing::bound_matrix(term, state);
  VectorX gradient = VectorX::Zero(kTwoBones.dof_count());
  EXPECT_GT(term.add_gradient(state, gradient), 0);
  EXPECT_TRUE(gradient.allFinite());
}

// Two parallel bones that overlap by 0.3 mm. The clearance of 1 mm comes on top.
TEST(SkeletonContact, ParallelBonesAreAFoundationOfSprings) {
  const Vector3 length(0, 0, 0.02);  // 8 places on each bone
  const auto capsule = [&](int body) {
    return BoneCapsule{static_cast<Finger>(body), false, body, -length / 2, length / 2, 0.004};
  };
  const SkeletonContact term({{capsule(0), capsule(1)}}, true, kTwoBones);
  State state = empty_state(kTwoBones);
  state.body_poses[1].position.x() = 2 * 0.004 - 0.3e-3;
  EXPECT_NEAR(term.value(state), 16 * 0.5 * 2e5 * 1.3e-3 * 1.3e-3, 1e-12);
  VectorX gradient = VectorX::Zero(kTwoBones.dof_count());
  term.add_gradient(state, gradient);
  EXPECT_NEAR(gradient[3 * kTwoBones.body_translation_block(0)], 16 * 2e5 * 1.3e-3, 1e-9);
  state.body_poses[1].position.x() = 2 * 0.004 + 1.1e-3;
  EXPECT_EQ(term.value(state), 0);
}

State posed(const HandModel& hand, const JointFrames& frames, int hands = 1) {
  State state = empty_state({0, hands * kBodyCount});
  for (int b = 0; b < hands * kBodyCount; ++b) {
    const auto body = static_cast<std::size_t>(b % kBodyCount);
    state.body_poses[static_cast<std::size_t>(b)] =
        frames[static_cast<std::size_t>(index_of(joint_of(static_cast<Body>(body))))] *
        hand.bodies[body].joint_from_body;
  }
  return state;
}

TEST(SkeletonContact, TheShippedHandsDoNotTouchThemselves) {
  for (const char* const name : {"right_400", "right_750", "left_750", "right_6000"}) {
    const HandModel hand = load_hand(std::string(SOFTHAND_SOURCE_DIR "/config/hands/") + name + ".hand.json");
    const SkeletonContact term({bone_capsules(hand)}, true, {0, kBodyCount});
    EXPECT_EQ(term.value(posed(hand, hand.rest_joints)), 0) << name;
    EXPECT_EQ(term.value(posed(hand, forward_kinematics(hand, Pose{}, open_hand(hand)))), 0) << name;
  }
}

TEST(SkeletonContact, HandsTouchUnlessTheyPassThroughEachOther) {
  const HandModel hand = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  SkeletonContact term({bone_capsules(hand), bone_capsules(hand, kBodyCount)}, false, {0, 2 * kBodyCount});
  State state = posed(hand, hand.rest_joints, 2);  // the second hand is inside the first one
  EXPECT_GT(term.value(state), 0);
  term.set_hands_passing(true);
  EXPECT_EQ(term.value(state), 0);
  term.set_hands_passing(false);
  for (std::size_t b = kBodyCount; b < state.body_poses.size(); ++b) state.body_poses[b].position.y() += 0.1;
  EXPECT_EQ(term.value(state), 0);
}

}  // namespace
}  // namespace softhand::skeleton_contact_test
