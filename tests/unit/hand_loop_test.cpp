// The hand loop and its tracked skeleton: following, jumps, state, direct mode and outputs.
#include "hand/hand_loop.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "messages/convert.hpp"
#include "support/soft_bodies.hpp"
#include "unit/hand_loop_rig.hpp"

namespace softhand::hand_loop_test {
namespace {

using testing::come_near_a_cube;
using testing::cube;
using testing::hand;
using testing::index;
using testing::kSecond;
using testing::loop_options;
using testing::skeleton_at;
using testing::world_with;

TEST(HandLoop, MovesToItsFirstSkeletonAtOnce) {
  HandLoop loop(hand(), loop_options(), {});
  const Pose wrist{Vector3(1, 1.2, -0.5), Quaternion::Identity()};
  const Skeleton first = skeleton_at(hand(), wrist, kSecond, 1);
  const HandOutput& output = loop.step(kSecond, {&first}, {});
  EXPECT_LE((to_vector(output.simulated.joints[index(Joint::index_tip)].position) -
             wrist * hand().rest_joints[index(Joint::index_tip)].position)
                .norm(),
            1e-3);
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

TEST(HandLoop, UnseenBoneMovesAlongInAJump) {
  HandLoop loop(hand(), loop_options(), {});
  const Skeleton first = skeleton_at(hand(), {}, kSecond, 1);
  loop.step(kSecond, {&first}, {});
  const Pose far{Vector3(10, 0, 0), Quaternion(Eigen::AngleAxisd(1, Vector3::UnitY()))};
  for (int i = 1; i <= 10; ++i) {
    const Nanoseconds now = kSecond + i * 11'111'111;
    Skeleton sample = skeleton_at(hand(), far, now, static_cast<std::uint64_t>(i) + 1);
    sample.joints[index(Joint::index_distal)].position[1] = std::numeric_limits<double>::quiet_NaN();
    loop.step(now, {&sample}, {});
  }
  EXPECT_EQ(loop.counters().repositioned, 1u);
  EXPECT_LE(loop.simulation().coupling_wrench(Body::index_distal).force.norm(), 0.01)
      << "N; nothing may pull towards the place ten metres away";
  EXPECT_LE((loop.simulation().joint_pose(Joint::index_tip).position -
             far * hand().rest_joints[index(Joint::index_tip)].position)
                .norm(),
            1e-3);
}

TEST(HandLoop, RefusesABoneWithNaNAndFollowsTheOthers) {
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

// The intermediate skeleton may come from another program.
TEST(HandLoop, RefusesAbsurdPosesAndUsesUnitQuaternions) {
  for (int field = 0; field < 3; ++field) {
    HandLoop loop(hand(), loop_options(), {});
    Skeleton sample = skeleton_at(hand(), {}, kSecond, 1);
    for (JointSample& joint : sample.joints)
      for (double& each : joint.orientation) each *= 1.009;
    loop.step(kSecond, {&sample}, {});
    const auto length = [&loop] {
      return (loop.simulation().joint_pose(Joint::index_tip).position -
              loop.simulation().joint_pose(Joint::wrist).position)
          .norm();
    };
    const double rest =
        (hand().rest_joints[index(Joint::index_tip)].position - hand().rest_joints[index(Joint::wrist)].position)
            .norm();
    EXPECT_NEAR(length(), rest, 1e-6);
    Skeleton absurd = skeleton_at(hand(), {}, kSecond + 11'111'111, 2);
    JointSample& wrist = absurd.joints[index(Joint::wrist)];
    (field == 0 ? wrist.position : field == 1 ? wrist.linear_velocity : wrist.angular_velocity)[0] = 1e15;
    loop.step(kSecond + 11'111'111, {&absurd}, {});
    sample = skeleton_at(hand(), {}, kSecond + 22'222'222, 3);
    loop.step(kSecond + 22'222'222, {&sample}, {});
    EXPECT_EQ(loop.counters().refused_nonfinite, 1u);
    EXPECT_EQ(loop.counters().failed_steps, 0u);
    EXPECT_NEAR(length(), rest, 1e-4) << "m, a hand far away would have lost its shape";
  }
}

TEST(HandLoop, RefusesABoneWithoutAnHonestConfidenceAndWeakensOneInDoubt) {
  const auto force_with = [](double confidence, std::uint64_t refused) {
    HandLoop loop(hand(), loop_options(), {});
    for (int i = 0; i <= 10; ++i) {
      const Nanoseconds now = kSecond + i * 11'111'111;
      Skeleton sample = skeleton_at(hand(), {}, now, static_cast<std::uint64_t>(i) + 1);
      JointSample& joint = sample.joints[index(Joint::index_distal)];
      if (i > 0) joint.position[1] += 0.003;
      if (i > 0) joint.confidence = confidence;
      loop.step(now, {&sample}, {});
    }
    EXPECT_EQ(loop.counters().refused_nonfinite, refused) << confidence;
    return loop.simulation().coupling_wrench(Body::index_distal).force.norm();
  };
  const double sure = force_with(1, 0), doubtful = force_with(0.1, 0);
  EXPECT_GT(sure, 0.1);
  EXPECT_LT(doubtful, 0.3 * sure);
  EXPECT_GT(force_with(0, 0), 0) << "a bone never floats";
  for (const double bad : {std::nan(""), -0.1, 1.5})
    EXPECT_LT(force_with(bad, 10), 0.05) << "it stays at its last pose";
}

TEST(HandLoop, OldSamplesAreRefused) {
  HandLoop loop(hand(), loop_options(), {});
  const Skeleton sample = skeleton_at(hand(), {}, kSecond, 5);
  loop.step(kSecond, {&sample}, {});
  loop.step(kSecond + 11'000'000, {&sample}, {});
  EXPECT_EQ(loop.counters().refused_order, 1u);
}

TEST(HandLoop, ReportsStaleInputWithinATenthOfASecond) {
  HandLoop loop(hand(), loop_options(), {});
  const Skeleton sample = skeleton_at(hand(), {}, kSecond, 1);
  for (int i = 0; i < 20; ++i) loop.step(kSecond + i * 11'111'111, {i == 0 ? &sample : nullptr}, {});
  EXPECT_GT(loop.counters().stale_steps, 5u);
  EXPECT_LT(loop.counters().stale_steps, 12u);
}

// Largest distance of the wrist from where it should be, while no skeleton comes for 110 ms. Before, the wrist moves
// with `speed`. The skeletons say that it moves by `noise` faster, in turn to both sides.
double farthest_without_samples(double speed, double noise) {
  HandLoop loop(hand(), loop_options(), {});
  const auto wrist_at = [&](int step) { return Vector3(speed * step / 90, 0, 0); };
  double farthest = 0;
  for (int i = 0; i < 40; ++i) {
    const Nanoseconds now = kSecond + i * 11'111'111;
    Skeleton sample =
        skeleton_at(hand(), {wrist_at(i), Quaternion::Identity()}, now, static_cast<std::uint64_t>(i) + 1);
    for (JointSample& joint : sample.joints) joint.linear_velocity = {speed + (i % 2 == 0 ? noise : -noise), 0, 0};
    loop.step(now, {i < 30 ? &sample : nullptr}, {});
    // The last sample is extrapolated for 50 ms. Then the hand waits.
    const Vector3 expected = wrist_at(std::min(i, 29)) + Vector3(speed * std::clamp((i - 29) / 90.0, 0.0, 0.05), 0, 0);
    if (i >= 20) farthest = std::max(farthest, (loop.simulation().joint_pose(Joint::wrist).position - expected).norm());
  }
  return farthest;
}

// The intermediate layer is stiff, so its velocity is mostly the tracker's noise: 0.1 mm give 0.3 m/s. Late samples
// were extrapolated with it for 50 ms, not 3 ms. That moved a resting hand by 15 mm, and a held cube by more than 5 mm.
TEST(HandLoop, NoiseOfTheVelocityDoesNotMoveAHandWithoutSamples) {
  EXPECT_LT(farthest_without_samples(0, 0.3), 1e-9);
  EXPECT_LT(farthest_without_samples(0.5, 0.3), 2e-3);
}

// The taken state is one in which an object is held. The second loop has another history of its solver and slots.
TEST(HandLoop, ContinuesLikeTheLoopWhoseStateItTook) {
  const HandModel model = hand();
  HandLoop one(model, loop_options(), {}), two(model, loop_options(), {});
  one.describe_object(cube(3));
  two.describe_object(cube(3));
  const Vector3 below(-0.012, -0.018 - 0.02 - 0.001, -0.092);
  const auto step = [&](HandLoop& loop, int i) {
    const Nanoseconds now = kSecond + i * 11'111'111;
    const Skeleton sample =
        skeleton_at(model, {Vector3(0, -0.004, 0), Quaternion::Identity()}, now, static_cast<std::uint64_t>(i));
    const WorldObjects world = world_with(3, below, now);
    loop.step(now, {&sample, nullptr, &world}, {});
  };
  step(two, 1);
  int i = 1;
  while (i < 60 && (one.simulation().contact_count() == 0 || one.simulation().slot_mode(0) != SlotMode::dynamic))
    step(one, i++);
  ASSERT_LT(i, 60) << "the cube must be touched and owned";
  two.take_state(one);
  for (const int end = i + 20; i < end; ++i) {
    step(one, i);
    step(two, i);
    ASSERT_EQ(one.simulation().contact_count(), two.simulation().contact_count()) << i;
    ASSERT_EQ((one.simulation().state().node_positions - two.simulation().state().node_positions).cwiseAbs().maxCoeff(),
              0)
        << i;
    ASSERT_EQ(one.simulation().slot_pose(0).position, two.simulation().slot_pose(0).position) << i;
  }
}

// After a reset the hand comes back elsewhere and is seen only in part. The earlier positions of its joints must not
// count.
TEST(HandLoop, ResetForgetsTheEarlierPositionsOfTheHand) {
  const HandModel model = hand();
  HandLoop loop(model, loop_options(), {});
  const Skeleton here = skeleton_at(model, {}, kSecond, 1);
  loop.step(kSecond, {&here}, {});
  loop.reset(kSecond);
  Skeleton there = skeleton_at(model, {Vector3(0.4, 0, 0), Quaternion::Identity()}, kSecond + 11'111'111, 2);
  there.joints[index(Joint::wrist)].flags = 0;
  EXPECT_FALSE(loop.step(kSecond + 11'111'111, {&there}, {}).valid) << "without a wrist the hand has no position yet";
  for (int i = 2; i < 20; ++i) {
    const Nanoseconds now = kSecond + i * 11'111'111;
    there = skeleton_at(model, {Vector3(0.4, 0, 0), Quaternion::Identity()}, now, static_cast<std::uint64_t>(i) + 1);
    there.joints[index(Joint::index_distal)].flags = 0;
    loop.step(now, {&there}, {});
  }
  EXPECT_LE(loop.simulation().coupling_wrench(Body::index_distal).force.norm(), 1e-9)
      << "N; nothing may pull towards the finger's earlier position";
  EXPECT_LE((loop.simulation().joint_pose(Joint::index_tip).position - Vector3(0.4, 0, 0) -
             model.rest_joints[index(Joint::index_tip)].position)
                .norm(),
            1e-3);
}

// The palms of two hands of one loop press on each other. The second hand plays also before the first one is known.
TEST(HandLoop, TwoHandsOfOneLoopTouchEachOther) {
  const HandModel right = hand(), left = mirrored(right);
  const HandKey keys[]{{0, 1}, {0, 0}};
  HandLoop loop({{right, keys[0]}, {left, keys[1]}}, loop_options());
  HandLoop loaded({{right, keys[0]}, {left, keys[1]}}, loop_options());
  EXPECT_THROW(HandLoop({{right, keys[0]}, {left, keys[0]}}, loop_options()), std::invalid_argument);
  EXPECT_THROW(HandLoop({{right, keys[0]}, {left, {1, 0}}}, loop_options()), std::invalid_argument);
  const Quaternion palm_up(Eigen::AngleAxisd(M_PI, Vector3::UnitZ()));
  Skeleton above, below;
  HandInput input;
  const auto step = [&](HandLoop& of, int i, double closer) {
    const Nanoseconds now = kSecond + i * 11'111'111;
    const auto sequence = static_cast<std::uint64_t>(i) + 1;
    above = skeleton_at(right, {Vector3(0, 0.020 - 0.5 * closer, 0), Quaternion::Identity()}, now, sequence);
    below = skeleton_at(left, {Vector3(0, -0.020 + 0.5 * closer, 0), palm_up}, now, sequence);
    return of.step(now, input, {});
  };
  input.second_skeleton = &below;
  EXPECT_FALSE(step(loop, 0, 0).valid) << "the first hand's pose is not known";
  EXPECT_TRUE(loop.plays());
  EXPECT_TRUE(loop.output(1).valid);
  input.skeleton = &above;
  for (int i = 1; i < 40; ++i) EXPECT_TRUE(step(loop, i, 0.01).valid);
  std::array<Vector3, 2> pushed;
  for (int h = 0; h < 2; ++h) {
    EXPECT_EQ(loop.output(h).simulated.hand, keys[h]);
    EXPECT_EQ(loop.output(h).surface.hand, keys[h]);
    EXPECT_EQ(static_cast<int>(loop.output(h).surface.nodes.size()), right.node_count());
    EXPECT_EQ(loop.description(h).hand, keys[h]);
    pushed[static_cast<std::size_t>(h)].setZero();
    for (const Vector3& force : loop.simulation().bone_contact_forces(h)) pushed[static_cast<std::size_t>(h)] += force;
  }
  EXPECT_GT(pushed[0].y(), 1);
  EXPECT_LE((pushed[0] + pushed[1]).norm(), 1e-9);
  EXPECT_EQ(loop.output().coupling.hand, keys[0]) << "the hands own objects under the key of the first";
  std::vector<std::byte> bytes(8 << 20);
  ByteWriter out(bytes);
  loop.save(out);
  loop.forget();
  bytes.resize(out.size());
  ByteReader in(bytes);
  loaded.load(in);
  for (HandLoop* of : {&loop, &loaded}) step(*of, 40, 0.01);
  EXPECT_EQ(loop.simulation().state().node_positions, loaded.simulation().state().node_positions);
  // After a reset no hand is known, and no step is made.
  loop.reset(kSecond + kSecond);
  input = {};
  EXPECT_FALSE(step(loop, 41, 0).valid);
  EXPECT_FALSE(loop.output(1).valid);
}

TEST(HandLoop, RefusesSkeletonsAndWorldsFromTheFuture) {
  constexpr Nanoseconds kHour = 3600 * kSecond;
  HandLoop loop(hand(), loop_options(), {});
  come_near_a_cube(loop);
  const WorldObjects ahead = world_with(4, Vector3(1, 0, 0), kSecond + kHour);
  const Skeleton far_away = skeleton_at(hand(), {Vector3(5, 0, 0), Quaternion::Identity()}, kSecond + kHour, 100);
  const Nanoseconds now = kSecond + 11'000'000;
  const HandOutput& output = loop.step(now, {&far_away, nullptr, &ahead}, {});
  EXPECT_EQ(output.coupling.twins.size(), 1u) << "the object is still there";
  EXPECT_LT(loop.simulation().joint_pose(Joint::wrist).position.norm(), 1);
  EXPECT_EQ(loop.counters().refused_future, 2u);
  LoopStatus status;
  loop.fill_status(status, now);
  EXPECT_NEAR(status.input_age_ms, 11, 1e-6);
  loop.fill_status(status, kSecond - 1'000'000);
  EXPECT_EQ(status.input_age_ms, 0);
}

TEST(HandLoop, PublishesTheBoneWrenchItselfInDirectMode) {
  HandOptions o = loop_options();
  o.direct = true;
  const HandModel model = hand();
  HandLoop loop(model, o, {});
  Nanoseconds now = kSecond;
  for (int i = 1; i < 40; ++i) {
    now += 11'111'111;
    const Skeleton sample =
        skeleton_at(model, {Vector3(0, 0.001 * i, 0), Quaternion::Identity()}, now, static_cast<std::uint64_t>(i));
    loop.step(now, {&sample}, {});
  }
  EXPECT_NEAR(loop.simulation().joint_pose(Joint::middle_tip).position.y(), 0.039, 3e-3);
  const Skeleton sample = skeleton_at(model, {Vector3(0, 0.039, 0), Quaternion::Identity()}, now, 1000);
  const HandOutput& output = loop.step(now, {&sample}, {});
  EXPECT_EQ(output.bone_wrench.simulated_valid, 1u);
}

TEST(HandLoop, BeginsWhenTheWristAppearsInDirectMode) {
  HandOptions o = loop_options();
  o.direct = true;
  HandLoop loop(hand(), o, {});
  Skeleton sample = skeleton_at(hand(), {}, kSecond, 1);
  sample.joints[index(Joint::wrist)].flags = 0;
  EXPECT_FALSE(loop.step(kSecond, {&sample}, {}).valid);
  sample = skeleton_at(hand(), {}, kSecond + 11'111'111, 2);
  EXPECT_TRUE(loop.step(kSecond + 11'111'111, {&sample}, {}).valid);
}

TEST(HandLoop, AcceptsATrackerWithAnotherClockAfterAResetInDirectMode) {
  HandOptions o = loop_options();
  o.direct = true;
  const HandModel model = hand();
  HandLoop loop(model, o, {});
  constexpr Nanoseconds hour = 3600 * kSecond;
  Skeleton sample = skeleton_at(model, {}, 1, 1);
  loop.step(hour, {&sample}, {});
  loop.reset(hour + 5'000'000);
  const Skeleton before = skeleton_at(model, {Vector3(2, 0, 0), Quaternion::Identity()}, hour + 4'000'000, 2);
  loop.step(hour + 11'000'000, {&before}, {});
  EXPECT_NEAR(loop.simulation().joint_pose(Joint::wrist).position.x(),
              model.rest_joints[index(Joint::wrist)].position.x(), 1e-2);
  sample = skeleton_at(model, {Vector3(1, 0, 0), Quaternion::Identity()}, 22'000'000, 3);
  loop.step(hour + 22'000'000, {&sample}, {});
  EXPECT_NEAR(loop.simulation().joint_pose(Joint::wrist).position.x(),
              1 + model.rest_joints[index(Joint::wrist)].position.x(), 1e-2);
}

// Latencies are computed from the chain. An incomplete chain would never count for a glove's latency.
TEST(HandLoop, ChainIsCompleteInDirectModeToo) {
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

MessageReply reset_object(HandLoop& loop, const char* name) {
  Message message;
  set_text(message.module, "hand");
  set_text(message.key, "object.reset");
  set_text(message.value, name);
  return loop.answer(message, "hand");
}

TEST(HandLoop, PublishesAFlexibleObjectAndPutsItBackOnRequestAndOnAReset) {
  const SoftObject block{.name = "block",
                         .body = testing::soft_box({2, 2, 2}, Vector3::Constant(0.04), testing::soft_material(1e4)),
                         .pose = {.position = {0, 1, 0}},
                         .gravity = testing::kGravity,
                         .file_name = "foam",
                         .file_sha256 = "abc"};
  HandLoop loop(hand(), loop_options(), {2, 1}, {}, {block});
  const std::vector<SoftObjectDescription> described = loop.soft_object_descriptions();
  ASSERT_EQ(described.size(), 1u);
  EXPECT_EQ(described[0].object, kFirstSoftObject);
  EXPECT_EQ(get_text(described[0].name), "block");
  EXPECT_EQ(get_text(described[0].file.name), "foam");
  EXPECT_EQ(described[0].owner, (HandKey{2, 1}));
  EXPECT_EQ(described[0].node_count, 27u);
  EXPECT_NEAR(described[0].mass, 100 * 0.04 * 0.04 * 0.04, 1e-9);

  Nanoseconds now = kSecond;
  const auto run = [&](int steps) -> const SoftObjectState& {
    for (int i = 0; i < steps; ++i) {
      now += 11'111'111;
      const Skeleton sample = skeleton_at(hand(), {}, now, static_cast<std::uint64_t>(now));
      WorldObjects empty;  // without it, the object waits
      empty.stamp.sample_time = now;
      loop.step(now, {&sample, nullptr, &empty}, {});
    }
    return loop.step(now += 11'111'111, {}, {}).soft_objects.front();
  };
  const SoftObjectState& state = run(20);
  EXPECT_EQ(state.stamp.sample_time, now);
  EXPECT_EQ(state.nodes.size(), 27u);
  const double fallen = 1 - state.centre[1];
  EXPECT_GT(fallen, 0.2) << "nothing holds it";

  EXPECT_EQ(reset_object(loop, "cube").result, kReplyIgnored) << "an object of the world";
  EXPECT_EQ(reset_object(loop, "block").result, kReplyApplied);
  EXPECT_GT(run(1).centre[1], 0.99);
  run(20);
  EXPECT_EQ(reset_object(loop, "*").result, kReplyApplied);
  EXPECT_GT(run(1).centre[1], 0.99);
  run(20);
  loop.reset(now);
  EXPECT_GT(run(1).centre[1], 0.99);
}

TEST(HandLoop, StatusCountsContactsWithFlexibleObjects) {
  const HandModel model = load_hand(SOFTHAND_SOURCE_DIR "/config/hands/right_400.hand.json");
  double low = 0;
  for (const Vector3& node : model.nodes) low = std::min(low, node.y());
  const SoftObject block{.name = "block",
                         .body = testing::soft_box({2, 2, 2}, Vector3::Constant(0.04), testing::soft_material(1e4)),
                         .pose = {.position = {0, low - 0.025, -0.1}}};
  HandLoop loop(model, {}, {}, {}, {block});
  std::uint32_t most = 0;
  for (int i = 1; i <= 80; ++i) {
    const Nanoseconds now = kSecond + i * 11'111'111;
    const Pose wrist{Vector3(0, i <= 60 ? 0 : -0.001 * (i - 60), 0), Quaternion::Identity()};
    const Skeleton sample = skeleton_at(model, wrist, now, static_cast<std::uint64_t>(i));
    loop.step(now, {&sample}, {});
    LoopStatus status;
    loop.fill_status(status, now);
    if (i <= 60) {
      EXPECT_EQ(status.contact_count, 0u);
    }
    most = std::max(most, status.contact_count);
  }
  EXPECT_GT(most, 0u) << "the block is pushed away";
  EXPECT_EQ(loop.simulation().contact_count(), 0) << "there is no object of the world";
}

TEST(HandLoop, UnwantedOutputsAreNotComputed) {
  HandLoop loop(hand(), loop_options(), {});
  const Skeleton sample = skeleton_at(hand(), {}, kSecond, 1);
  const HandOutput& output = loop.step(kSecond, {&sample}, {.surface = false, .contacts = false, .traction = false});
  EXPECT_TRUE(output.surface.nodes.empty());
  EXPECT_EQ(output.contacts.stamp.sequence, 0u);
  EXPECT_EQ(output.traction.stamp.sequence, 0u);
}

// An approach, a touch and a grip, with and without things that the scene does not need.
TEST(HandLoop, OmittedOutputsAndUntouchedObjectsChangeNoBit) {
  const HandModel model = hand();
  struct Run {
    std::vector<State> states;
    bool touched = false;
    int mirrored = 0;  // objects in slots at the end
  };
  const auto run = [&model](const HandOptions& options, const RequestedOutputs& requested, std::uint32_t far_objects,
                            std::uint32_t near_objects = 0) {
    HandLoop loop(model, options, {});
    loop.describe_object(cube(3));
    for (std::uint32_t id = 0; id < far_objects; ++id) loop.describe_object(cube(100 + id));
    for (std::uint32_t id = 0; id < near_objects; ++id) loop.describe_object(cube(200 + id));
    Run result;
    Nanoseconds now = kSecond;
    for (int i = 0; i < 60; ++i) {
      now += 11'111'111;
      const Skeleton sample = skeleton_at(model, {Vector3(0, i < 20 ? 0.005 : -0.004, 0), Quaternion::Identity()}, now,
                                          static_cast<std::uint64_t>(i) + 1);
      WorldObjects world = world_with(3, Vector3(-0.012, -0.018 - 0.02 - 0.001, -0.092), now);
      for (std::uint32_t id = 0; id < far_objects; ++id)
        world.objects.push_back(world_with(100 + id, Vector3(1 + 0.1 * id, 0, 0), now).objects[0]);
      for (std::uint32_t id = 0; id < near_objects; ++id)
        world.objects.push_back(world_with(200 + id, Vector3(-0.012 + 0.001 * id, 0.06, -0.09), now).objects[0]);
      loop.step(now, {&sample, nullptr, &world}, requested);
      result.states.push_back(loop.simulation().state());
      result.touched = result.touched || loop.simulation().contact_count() > 0;
    }
    for (int slot = 0; slot < loop.simulation().slot_count(); ++slot)
      result.mirrored += loop.simulation().slot_mode(slot) != SlotMode::empty;
    return result;
  };
  const auto largest_difference = [](const Run& left, const Run& right) {
    double largest = 0;
    for (std::size_t i = 0; i < left.states.size(); ++i) {
      largest =
          std::max(largest, (left.states[i].node_positions - right.states[i].node_positions).cwiseAbs().maxCoeff());
      for (std::size_t b = 0; b < kBodyCount; ++b)
        largest =
            std::max(largest, (left.states[i].body_poses[b].position - right.states[i].body_poses[b].position).norm());
    }
    return largest;
  };
  const RequestedOutputs nothing{false, false, false, false, false}, everything;
  const Run plain = run(loop_options(), nothing, 0);
  ASSERT_TRUE(plain.touched);
  EXPECT_EQ(largest_difference(run(loop_options(), everything, 0), plain), 0) << "topics with readers";
  EXPECT_EQ(largest_difference(run(loop_options(), nothing, 40), plain), 0) << "objects out of reach";
  HandOptions spare = loop_options();
  spare.mirrored_objects = 25;
  EXPECT_EQ(largest_difference(run(spare, nothing, 0), plain), 0) << "slots without objects";
  const Run among = run(spare, nothing, 0, 24);
  EXPECT_EQ(among.mirrored, 25);
  EXPECT_EQ(largest_difference(among, plain), 0) << "near objects that nothing touches";
}

}  // namespace
}  // namespace softhand::hand_loop_test
