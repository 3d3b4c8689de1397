// The physics of the tracking loop: rest, lag, coupling, wrenches, options.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "unit/tracking_rig.hpp"

namespace softhand::tracking_test {
namespace {

using namespace testing::tracking;

TEST(Tracking, RestIsStationaryAndTipsFollowTheirBones) {
  TrackingLoop loop({}, kHandRate, hand(), {});
  run(
      loop, 0.5, 90, [](double) { return still(); },
      [](double, const TrackingOutput& out) {
        ASSERT_TRUE(out.valid);
        for (std::size_t j = 0; j < kJointCount; ++j) {
          const Pose expected = still() * hand().rest_joints[j];
          EXPECT_LT((position(out.intermediate, j) - expected.position).norm(), 1e-12) << kJointNames[j];
          EXPECT_LT(
              rotation_log(to_quaternion(out.intermediate.joints[j].orientation) * expected.orientation.conjugate())
                  .norm(),
              1e-7);
        }
      });
}

// The hand is shaken and turned. A simulated hand, which is missing for a while, pulls it back. The hand is
// repositioned once.
TEST(Tracking, EnergyLedgerClosesAndTheDampersDissipateTheWork) {
  TrackingLoop loop(TrackingOptions{}, kHandRate, hand(), {});
  Skeleton simulated;
  for (int i = 0; i < 3000; ++i) {
    const double t = 1e-3 * i;
    const Nanoseconds now = kStart + i * kMillisecond;
    const Vector3 place = i < 2000 ? Vector3(0.02 * std::sin(12 * t), 1, 0.03 * t) : Vector3(2, 1, 0);
    const Skeleton sample = skeleton_at({place, rotation_exp(Vector3(0, 0.8 * std::sin(9 * t), 0.2))},
                                        static_cast<std::uint64_t>(i) + 1, now);
    TrackingInput input;
    if (i % 11 == 0) input.tracked = &sample;
    if (i % 11 == 5 && (i < 800 || i > 1200)) {
      simulated =
          skeleton_at({place + Vector3(0.004, 0, 0), Quaternion::Identity()}, static_cast<std::uint64_t>(i) + 1, now);
      input.simulated = &simulated;
    }
    loop.step(now, input);
  }
  const EnergyLedger& ledger = loop.ledger();
  ASSERT_GT(loop.input().counters().repositioned, 0u);
  ASSERT_GT(ledger.total().damping, 1e-3);
  EXPECT_LE(ledger.defect(), 1e-3);
  EXPECT_GT(ledger.total().integrator, 0);
  EXPECT_EQ(ledger.total().friction, 0);
  LoopStatus status;
  loop.fill_status(status, kStart);
  ASSERT_FALSE(status.ledger.empty());
  TrackingInput without_ledger;
  without_ledger.ledger_requested = false;
  loop.step(kStart + 3000 * kMillisecond, without_ledger);
  EXPECT_FALSE(loop.ledger().started());
}

TEST(Tracking, NothingIsPublishedBeforeTheFirstSample) {
  TrackingLoop loop({}, kHandRate, hand(), {});
  EXPECT_FALSE(loop.step(kStart, {}).valid);
}

// Measured: 0.9 ms, with the sample extrapolated by its age. The lag of a fingertip is offset / speed. The tracker runs
// at 90 Hz and is 20 ms late.
TEST(Tracking, LagInSteadyMotionIsAMillisecond) {
  TrackingLoop loop({}, kHandRate, hand(), {});
  const double speed = 0.8;
  const auto wrist = [&](double t) { return Pose{Vector3(speed * t, 1, 0), Quaternion::Identity()}; };
  double sum = 0, worst = 0;
  int count = 0;
  run(
      loop, 2, 90, wrist,
      [&](double t, const TrackingOutput& out) {
        if (t < 1) return;
        const double lag =
            ((wrist(t) * hand().rest_joints[kIndexTip]).position.x() - position(out.intermediate, kIndexTip).x()) /
            speed;
        sum += lag;
        worst = std::max(worst, std::abs(lag));
        ++count;
        EXPECT_NEAR(out.intermediate.joints[kIndexTip].linear_velocity[0], speed, 0.01);
      },
      20 * kMillisecond);
  RecordProperty("lag_ms", std::to_string(1e3 * sum / count));
  EXPECT_GT(sum / count, 0);
  EXPECT_LT(worst, 2e-3);
}

TEST(Tracking, LagOfAShakenHandIsAFewMilliseconds) {
  TrackingLoop loop({}, kHandRate, hand(), {});
  // 3 Hz and 5 cm give 0.94 m/s. The lag is the time shift that fits best, from the projections on sine and cosine.
  const double omega = 2 * std::numbers::pi * 3;
  const auto wrist = [&](double t) { return Pose{Vector3(0.05 * std::sin(omega * t), 1, 0), Quaternion::Identity()}; };
  double in = 0, quadrature = 0;
  const double offset = hand().rest_joints[kIndexTip].position.x();
  run(
      loop, 3, 90, wrist,
      [&](double t, const TrackingOutput& out) {
        if (t < 1) return;
        const double x = position(out.intermediate, kIndexTip).x() - offset;
        in += x * std::sin(omega * t);
        quadrature += x * std::cos(omega * t);
      },
      11 * kMillisecond);
  const double lag = -std::atan2(quadrature, in) / omega;
  RecordProperty("lag_ms", std::to_string(1e3 * lag));
  EXPECT_LT(std::abs(lag), 4e-3);
}

TEST(Tracking, RotationIsFollowedThroughPiWithAndWithoutSignFlips) {
  TrackingLoop loop({}, kHandRate, hand(), {});
  const double speed = 2 * std::numbers::pi;  // 720 degrees in 2 s
  std::uint64_t sequence = 0;
  for (int i = 0; i < 2000; ++i) {
    const double t = i * 1e-3;
    const Pose wrist{Vector3(0, 1, 0), Quaternion(Eigen::AngleAxisd(speed * t, Vector3(1, 2, 2) / 3))};
    TrackingInput input;
    Skeleton sample;
    if (i % 11 == 0) {
      sample = skeleton_at(wrist, ++sequence, kStart + i * kMillisecond);
      if (sequence % 2 == 0) {
        for (auto& joint : sample.joints) {
          for (double& x : joint.orientation) x = -x;
        }
      }
      input.tracked = &sample;
    }
    const TrackingOutput& out = loop.step(kStart + i * kMillisecond, input);
    if (i < 200) continue;
    const Vector3 error =
        rotation_log(to_quaternion(out.intermediate.joints[kWrist].orientation) * wrist.orientation.conjugate());
    ASSERT_LT(error.norm(), speed * 3e-3) << t;
    ASSERT_NEAR(to_vector(out.intermediate.joints[kWrist].angular_velocity).norm(), speed, 0.1);
  }
}

// Two couplings in series have the offset F (1/k1 + 1/k2). A wall keeps the simulated hand at distance d. So k_feedback
// pulls the intermediate hand against k1.
TEST(Tracking, SimulatedSkeletonPullsByTheRatioOfTheStiffnesses) {
  TrackingOptions options;
  TrackingLoop loop(options, kHandRate, hand(), {});
  const double d = 0.004;
  TrackingOutput last;
  std::uint64_t sequence = 0;
  for (int i = 0; i < 1000; ++i) {
    const Nanoseconds now = kStart + i * kMillisecond;
    const Skeleton tracked = skeleton_at(still(), ++sequence, now);
    Pose held = still();
    held.position.y() += d;
    const Skeleton simulated = skeleton_at(held, sequence, now);
    TrackingInput input;
    input.tracked = &tracked;
    input.simulated = &simulated;
    last = loop.step(now, input);
  }
  const double kf = options.feedback_ratio * 500, k1 = 15 * 500;
  const double offset =
      position(last.intermediate, kIndexDistal).y() - (still() * hand().rest_joints[kIndexDistal]).position.y();
  EXPECT_NEAR(offset, d * kf / (kf + k1), 1e-8);
  const BoneSample& bone = last.wrench.bones[8];
  ASSERT_EQ(last.wrench.simulated_valid, 1u);
  EXPECT_NEAR(bone.coupling_force[1], 500 * (d - offset), 1e-5);
  EXPECT_NEAR(bone.coupling_force[0], 0, 1e-9);
}

// The local model of a haptic device: where a bone touches, its coupling to the simulated bone is the wall.
TEST(Tracking, WrenchHasThePlaneOfABonesContactsWhileTheyAreFresh) {
  TrackingOptions options;
  TrackingLoop loop(options, kHandRate, hand(), {});
  const auto contacts = std::make_unique<Contacts>();
  const Pose tip = still() * hand().rest_joints[kIndexDistal];
  Contact contact;
  contact.body = 8;
  contact.point = to_wire(Vector3(tip.position + Vector3(0.001, -0.006, 0)));
  contact.normal = {0, 1, 0};
  contact.force = {0.3, 1, 0};
  contact.velocity = {0.1, 0.2, 0};
  contacts->contacts.push_back(contact);
  NearContact near;  // comes with 0.1 m/s
  near.body = 11;
  const auto near_joint = static_cast<std::size_t>(index_of(joint_of(static_cast<Body>(near.body))));
  near.gap = 0.006;
  near.normal = {0, 1, 0};
  near.velocity = {0, 0.1, 0};
  contacts->near.push_back(near);
  std::uint64_t sequence = 0;
  int with_plane = 0;
  for (int i = 0; i < 1000; ++i) {
    const Nanoseconds now = kStart + i * kMillisecond;
    const Skeleton tracked = skeleton_at(still(), ++sequence, now);
    Pose held = still();
    held.position.y() += 0.004;
    Skeleton simulated = skeleton_at(held, sequence, now);
    simulated.joints[1].linear_velocity = {0, 0, 0.3};
    if (i % 10 == 0) contacts->stamp.sample_time = now;
    TrackingInput input;
    input.tracked = &tracked;
    input.simulated = &simulated;
    input.contacts = i < 800 ? contacts.get() : nullptr;
    const BoneWrench& wrench = loop.step(now, input).wrench;
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      if (b != 8 && b != 11) {
        ASSERT_EQ(wrench.bones[b].contact_stiffness, 0) << b;
        ASSERT_EQ(wrench.bones[b].contact_normal, Vec3{}) << b;
      }
    }
    const BoneSample& bone = wrench.bones[8];
    if (bone.contact_stiffness == 0) continue;
    ++with_plane;
    ASSERT_EQ(bone.contact_normal, (Vec3{0, 1, 0}));
    ASSERT_EQ(bone.contact_point, contact.point);
    ASSERT_EQ(bone.contact_velocity, contact.velocity);
    ASSERT_EQ(wrench.wrist_velocity, (Vec3{0, 0, 0.3}));
    // The object comes nearer while its message gets older.
    const BoneSample& other = wrench.bones[11];
    const double moved = other.intermediate_position[1] - simulated.joints[near_joint].position[1];
    ASSERT_NEAR(other.contact_gap, 0.006 + moved - 1e-4 * (i < 800 ? i % 10 : i - 790), 1e-12);
    ASSERT_EQ(other.contact_velocity, near.velocity);
    ASSERT_EQ(bone.contact_stiffness, 500);
    ASSERT_NEAR(bone.contact_damping, 2 * std::sqrt(500 * hand().bodies[8].mass), 1e-12);
  }
  EXPECT_NEAR(with_plane, 800 + 40, 2);  // stale after 40 ms
}

// Both springs of the bone weaken alike, so it stays where it is. The force on the user weakens with them, and the hand
// is told to weaken its own spring.
TEST(Tracking, ConfidenceOfAJointScalesTheCouplingOfItsBone) {
  const auto run_with = [](double confidence) {
    TrackingLoop loop({}, kHandRate, hand(), {});
    TrackingOutput last;
    for (int i = 0; i < 1000; ++i) {
      const Nanoseconds now = kStart + i * kMillisecond;
      const auto sequence = static_cast<std::uint64_t>(i) + 1;
      Skeleton tracked = skeleton_at(still(), sequence, now);
      tracked.joints[kIndexDistal].confidence = confidence;
      Pose held = still();
      held.position.y() += 0.004;
      const Skeleton simulated = skeleton_at(held, sequence, now);
      TrackingInput input;
      input.tracked = &tracked;
      input.simulated = &simulated;
      last = loop.step(now, input);
    }
    return last;
  };
  const TrackingOutput sure = run_with(1), doubtful = run_with(0.2), none = run_with(0);
  const double force = sure.wrench.bones[8].coupling_force[1];
  ASSERT_GT(force, 1);
  EXPECT_NEAR(doubtful.wrench.bones[8].coupling_force[1], 0.2 * force, 1e-6);
  EXPECT_NEAR(none.wrench.bones[8].coupling_force[1], kLeastConfidence * force, 1e-6);
  EXPECT_EQ(doubtful.wrench.bones[7].coupling_force, sure.wrench.bones[7].coupling_force) << "another bone";
  EXPECT_NEAR(position(doubtful.intermediate, kIndexDistal).y(), position(sure.intermediate, kIndexDistal).y(), 1e-8);
  EXPECT_EQ(sure.intermediate.joints[kIndexDistal].confidence, 1);
  EXPECT_NEAR(doubtful.intermediate.joints[kIndexDistal].confidence, 0.2, 1e-6);
  EXPECT_NEAR(doubtful.intermediate.joints[kIndexTip].confidence, 0.2, 1e-6);
  EXPECT_EQ(doubtful.intermediate.joints[kIndexIntermediate].confidence, 1);
}

// The springs of all bones weaken and recover again and again while the hand is shaken.
TEST(Tracking, EnergyLedgerClosesWhileTheConfidenceChanges) {
  TrackingLoop loop(TrackingOptions{}, kHandRate, hand(), {});
  Skeleton simulated;
  for (int i = 0; i < 3000; ++i) {
    const double t = 1e-3 * i;
    const Nanoseconds now = kStart + i * kMillisecond;
    const auto sequence = static_cast<std::uint64_t>(i) + 1;
    const Vector3 place(0.02 * std::sin(12 * t), 1, 0.03 * t);
    Skeleton sample = skeleton_at({place, rotation_exp(Vector3(0, 0.8 * std::sin(9 * t), 0.2))}, sequence, now);
    for (JointSample& joint : sample.joints) joint.confidence = i / 200 % 2;
    TrackingInput input;
    if (i % 11 == 0) input.tracked = &sample;
    if (i % 11 == 5) {
      simulated = skeleton_at({place + Vector3(0.004, 0, 0), Quaternion::Identity()}, sequence, now);
      input.simulated = &simulated;
    }
    loop.step(now, input);
  }
  ASSERT_GT(loop.ledger().total().damping, 1e-3);
  EXPECT_LE(loop.ledger().defect(), 1e-3);
  EXPECT_GT(loop.ledger().total().integrator, 0);
}

TEST(Tracking, WrenchIsCappedAndZeroWhenTheSimulationIsStale) {
  TrackingOptions options;
  TrackingLoop loop(options, kHandRate, hand(), {});
  std::uint64_t sequence = 0;
  bool zeroed = false;
  for (int i = 0; i < 200; ++i) {
    const Nanoseconds now = kStart + i * kMillisecond;
    const Skeleton tracked = skeleton_at(still(), ++sequence, now);
    Pose far = still();
    far.position.y() += 0.3;
    const Skeleton simulated = skeleton_at(far, sequence, now);
    TrackingInput input;
    input.tracked = &tracked;
    if (i < 100) input.simulated = &simulated;
    const TrackingOutput& out = loop.step(now, input);
    double total = 0;
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const double force = to_vector(out.wrench.bones[b].coupling_force).norm();
      EXPECT_LE(force, hand().bodies[b].coupling_force_cap * (1 + 1e-12));
      total += force;
    }
    EXPECT_LE(total, 100.0);
    if (i == 99) {
      EXPECT_GT(total, 50);
    }
    if (i > 99 + 1e3 * options.simulated_stale_after) {
      EXPECT_EQ(total, 0);
      EXPECT_EQ(out.wrench.simulated_valid, 0u);
      zeroed = true;
    }
  }
  EXPECT_TRUE(zeroed);
}

TEST(Tracking, RefusesUnstableOptionsAndSuggestsStableOnes) {
  EXPECT_LT(chain_growth({}, kHandRate, hand()), 1);
  // Equal masses, equal stiffnesses, a feedback spring as strong as the forward one, and a tenth of critical damping.
  TrackingOptions bad;
  bad.mass_fraction = 1;
  bad.stiffness_ratio = 1;
  bad.feedback_ratio = 1;
  bad.damping_ratio = 0.1;
  const double growth = chain_growth(bad, kHandRate, hand());
  ASSERT_GT(growth, 1);
  try {
    TrackingLoop loop(bad, kHandRate, hand(), {});
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    const std::string text = error.what();
    TrackingOptions offered = bad;
    ASSERT_EQ(
        std::sscanf(text.c_str() + text.find("e.g."), "e.g. stiffness_ratio %lf, feedback_ratio %lf, mass_fraction %lf",
                    &offered.stiffness_ratio, &offered.feedback_ratio, &offered.mass_fraction),
        3)
        << text;
    EXPECT_LT(chain_growth(offered, kHandRate, hand()), 1) << text;
  }
}

TEST(Tracking, SameInputsGiveTheSameBits) {
  const auto last = [] {
    TrackingLoop loop({}, kHandRate, hand(), {});
    Skeleton result;
    run(
        loop, 1, 90,
        [](double t) {
          return Pose{Vector3(std::sin(9 * t), 1, 0), rotation_exp(Vector3(t, 2 * t, 0))};
        },
        [&](double, const TrackingOutput& out) { result = out.intermediate; });
    return result;
  };
  const Skeleton a = last(), b = last();
  for (std::size_t j = 0; j < kJointCount; ++j) EXPECT_EQ(a.joints[j].position, b.joints[j].position);
}

TEST(Tracking, EveryMessageIsAnswered) {
  TrackingLoop loop({}, kHandRate, hand(), {});
  Message message;
  message.id = 42;
  set_text(message.module, "hand");
  EXPECT_EQ(loop.answer(message, "tracking").result, kReplyIgnored);
  set_text(message.module, "*");
  set_text(message.key, "feedback_ratio");
  set_text(message.value, "0.05");
  const MessageReply reply = loop.answer(message, "tracking");
  EXPECT_EQ(reply.result, kReplyApplied);
  EXPECT_EQ(reply.id, 42u);
  set_text(message.value, "0.9");
  EXPECT_EQ(loop.answer(message, "tracking").result, kReplyRefused);
  set_text(message.value, "nan");
  EXPECT_EQ(loop.answer(message, "tracking").result, kReplyRefused);
}

}  // namespace
}  // namespace softhand::tracking_test
