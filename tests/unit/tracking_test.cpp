// The tracking loop's physics and its treatment of a tracker's samples.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "support/block_hand.hpp"
#include "tracking/tracking_loop.hpp"

namespace softhand {
namespace {

constexpr Nanoseconds kMillisecond = 1'000'000;
constexpr Nanoseconds kStart = 10'000 * kMillisecond;
constexpr std::size_t kWrist = 1, kIndexTip = 10, kIndexDistal = 9, kIndexIntermediate = 8;

const HandModel& hand() {
  static const HandModel model = testing::block_hand();
  return model;
}

Skeleton skeleton_at(const Pose& wrist, std::uint64_t sequence, Nanoseconds time) {
  Skeleton out;
  out.stamp.sequence = sequence;
  out.stamp.epoch = 7;
  out.stamp.sample_time = out.stamp.publish_time = time;
  out.confidence = 1;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const Pose pose = wrist * hand().rest_joints[j];
    out.joints[j].position = to_wire(pose.position);
    out.joints[j].orientation = to_wire(pose.orientation);
    out.joints[j].flags = kJointValid | kJointTracked;
  }
  return out;
}

constexpr double kHandRate = 90;  // Hz

Pose still() { return {Vector3(0.1, 1.2, -0.3), Quaternion::Identity()}; }

// Runs the loop at 1 kHz with a tracker at `rate` (Hz). The tracked wrist is at `wrist(t)`. `after(t, output)` is
// called after each step.
template <typename Motion, typename After>
void run(TrackingLoop& loop, double seconds, double rate, Motion wrist, After after, Nanoseconds latency = 0) {
  std::uint64_t sent = 0;
  for (int i = 0; i < static_cast<int>(seconds * 1000); ++i) {
    const Nanoseconds now = kStart + i * kMillisecond;
    const double t = i * 1e-3;
    Skeleton sample;
    TrackingInput input;
    const auto due =
        static_cast<std::uint64_t>(std::floor((t - static_cast<double>(latency) * 1e-9) * rate + 1e-9) + 1);
    if (t * 1e9 >= static_cast<double>(latency) && due > sent) {
      sent = due;
      const double taken = static_cast<double>(due - 1) / rate;
      sample = skeleton_at(wrist(taken), due, kStart + static_cast<Nanoseconds>(taken * 1e9));
      input.tracked = &sample;
    }
    after(t, loop.step(now, input));
  }
}

Vector3 position(const Skeleton& s, std::size_t joint) { return to_vector(s.joints[joint].position); }

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
  contacts->contacts.push_back(contact);
  std::uint64_t sequence = 0;
  int with_plane = 0;
  for (int i = 0; i < 1000; ++i) {
    const Nanoseconds now = kStart + i * kMillisecond;
    const Skeleton tracked = skeleton_at(still(), ++sequence, now);
    Pose held = still();
    held.position.y() += 0.004;
    const Skeleton simulated = skeleton_at(held, sequence, now);
    contacts->stamp.sample_time = now;
    TrackingInput input;
    input.tracked = &tracked;
    input.simulated = &simulated;
    input.contacts = i < 800 ? contacts.get() : nullptr;
    const BoneWrench& wrench = loop.step(now, input).wrench;
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      if (b != 8) {
        ASSERT_EQ(wrench.bones[b].contact_stiffness, 0) << b;
        ASSERT_EQ(wrench.bones[b].contact_normal, Vec3{}) << b;
      }
    }
    const BoneSample& bone = wrench.bones[8];
    if (bone.contact_stiffness == 0) continue;
    ++with_plane;
    ASSERT_EQ(bone.contact_normal, (Vec3{0, 1, 0}));
    ASSERT_EQ(bone.contact_point, contact.point);
    ASSERT_EQ(bone.contact_stiffness, 500);
    ASSERT_NEAR(bone.contact_damping, 2 * std::sqrt(500 * hand().bodies[8].mass), 1e-12);
  }
  EXPECT_NEAR(with_plane, 800 + 40, 2);  // stale after 40 ms
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

TEST(Tracking, NonFiniteBoneIsRefusedAndTheOthersAreTracked) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(), 1e308}) {
    TrackingLoop loop({}, kHandRate, hand(), {});
    std::uint64_t sequence = 0;
    for (int i = 0; i < 500; ++i) {
      const Nanoseconds now = kStart + i * kMillisecond;
      const Pose wrist{Vector3(0.3e-3 * i, 1, 0), Quaternion::Identity()};
      Skeleton sample = skeleton_at(wrist, ++sequence, now);
      if (i >= 250) sample.joints[kIndexIntermediate].position[1] = bad;
      TrackingInput input;
      input.tracked = &sample;
      const TrackingOutput& out = loop.step(now, input);
      for (std::size_t j = 0; j < kJointCount; ++j) {
        ASSERT_TRUE(all_finite(out.intermediate.joints[j].position));
        ASSERT_TRUE(all_finite(out.intermediate.joints[j].linear_velocity));
        // The refused joint moves with its neighbour, so all joints follow.
        ASSERT_LT((position(out.intermediate, j) - (wrist * hand().rest_joints[j]).position).norm(), 2e-3)
            << kJointNames[j];
      }
    }
    const TrackedInputCounters& c = loop.input().counters();
    EXPECT_EQ(c.refused_nonfinite + c.refused_implausible, 250u);
    EXPECT_EQ(c.inferred, 250u);
  }
}

TEST(Tracking, QuaternionsOfAnyReasonableLengthAreNormalised) {
  struct Case {
    double length;
    bool good;
  };
  for (const Case c :
       {Case{0.5, true}, Case{2, true}, Case{1e-20, false}, Case{0, false}, Case{5e-324, false}, Case{3, false}}) {
    TrackedInput input({});
    Skeleton sample = skeleton_at(still(), 1, kStart);
    for (double& x : sample.joints[kIndexDistal].orientation) x *= c.length;
    ASSERT_TRUE(input.add_sample(sample, kStart));
    EXPECT_EQ(input.counters().refused_implausible, c.good ? 0u : 1u) << c.length;
    EXPECT_NEAR(input.targets(kStart)[8].pose.orientation.norm(), 1, 1e-12);
  }
}

TEST(Tracking, DuplicatesReorderedSamplesAndEqualStampsAreIgnored) {
  TrackedInput input({});
  EXPECT_TRUE(input.add_sample(skeleton_at(still(), 5, kStart), kStart));
  EXPECT_FALSE(input.add_sample(skeleton_at(still(), 5, kStart), kStart));
  EXPECT_FALSE(input.add_sample(skeleton_at(still(), 4, kStart - kMillisecond), kStart));
  EXPECT_FALSE(input.add_sample(skeleton_at(still(), 6, kStart), kStart + kMillisecond));
  EXPECT_EQ(input.counters().refused_order, 3u);
  EXPECT_TRUE(input.add_sample(skeleton_at(still(), 7, kStart + kMillisecond), kStart + kMillisecond));
  // A restarted tracker counts from 1 again under a new epoch.
  Skeleton restarted = skeleton_at(still(), 1, kStart + 2 * kMillisecond);
  restarted.stamp.epoch = 8;
  EXPECT_TRUE(input.add_sample(restarted, kStart + 2 * kMillisecond));
}

// Two trackers of a moving hand differ by 20 mm and 0.2 rad. The hand goes from one to the other.
TEST(Tracking, ASwapOfTrackersIsNoJump) {
  TrackedInput input({});
  const auto wrist_at = [](double time, bool second) {
    return Pose{Vector3(0.3 * time, second ? 0.02 : 0, 0), rotation_exp(Vector3(0, 0, second ? 0.2 : 0))};
  };
  std::uint64_t sequence = 0;
  Pose last;
  double fastest = 0, fastest_turn = 0, largest_error = 0;
  for (int i = 0; i < 1000; ++i) {  // 1 kHz, samples at 100 Hz
    const Nanoseconds now = kStart + i * kMillisecond;
    const double time = 1e-3 * i;
    const bool second = i >= 500;
    if (i % 10 == 0) {
      Skeleton sample = skeleton_at(wrist_at(time, second), ++sequence, now);
      sample.stamp.epoch = second ? 8 : 7;
      ASSERT_TRUE(input.add_sample(sample, now));
    }
    const BodyTarget& target = input.targets(now)[1];
    if (i > 100) {
      fastest = std::max(fastest, (target.pose.position - last.position).norm() * 1e3);
      fastest_turn = std::max(fastest_turn, target.pose.orientation.angularDistance(last.orientation) * 1e3);
      if (i % 10 != 0)  // the velocity is that of the motion between samples
        largest_error =
            std::max(largest_error, (1e3 * (target.pose.position - last.position) - target.velocity.linear).norm());
    }
    last = target.pose;
  }
  EXPECT_EQ(input.counters().swapped, 1u);
  EXPECT_EQ(input.counters().repositioned, 0u);
  EXPECT_LT((last.position - wrist_at(0.999, true).position).norm(), 1e-6);
  // The difference fades out in 0.2 s, at most 1.5 times as fast as its mean: 0.15 m/s and 1.5 rad/s.
  EXPECT_LT(fastest, 0.36);
  EXPECT_GT(fastest, 0.32);
  EXPECT_LT(fastest_turn, 1.6);
  EXPECT_LT(largest_error, 0.01);
}

TEST(Tracking, UsesTheTimeOfArrivalIfTheTrackersClockIsImplausible) {
  for (const Nanoseconds shift : {3'600'000 * kMillisecond, -3'600'000 * kMillisecond}) {
    TrackedInput input({});
    for (int i = 1; i <= 50; ++i) {
      const Nanoseconds now = kStart + i * 11 * kMillisecond;
      const Pose wrist{Vector3(0.011 * i * 0.5, 0, 0), Quaternion::Identity()};
      ASSERT_TRUE(input.add_sample(skeleton_at(wrist, static_cast<std::uint64_t>(i), now + (i < 25 ? 0 : shift)), now));
      EXPECT_LT((input.targets(now)[1].pose.position - wrist.position).norm(), 1e-12);
      if (i > 10) {
        EXPECT_NEAR(input.targets(now)[1].velocity.linear.x(), 0.5, 0.01);
      }
    }
    EXPECT_EQ(input.counters().implausible_clock, 26u);
  }
}

TEST(Tracking, FrozenTrackerHoldsTheHandAndIsStaleWithin100Milliseconds) {
  TrackingLoop loop({}, kHandRate, hand(), {});
  Vector3 at_hold = Vector3::Zero();
  std::uint64_t sequence = 0;
  const double speed = 0.5;
  for (int i = 0; i < 3000; ++i) {
    const Nanoseconds now = kStart + i * kMillisecond;
    TrackingInput input;
    Skeleton sample;
    if (i <= 990 && i % 11 == 0) {
      sample = skeleton_at({Vector3(speed * i * 1e-3, 1, 0), Quaternion::Identity()}, ++sequence, now);
      input.tracked = &sample;
    }
    const TrackingOutput& out = loop.step(now, input);
    if (i == 990 + 100) {
      EXPECT_TRUE(loop.input().stale(now));
      EXPECT_EQ(out.intermediate.confidence, 0);
      at_hold = position(out.intermediate, kWrist);
      // Extrapolation is limited to 50 ms.
      EXPECT_NEAR(at_hold.x(), speed * (0.990 + 0.05), 1e-3);
    }
    if (i > 1200) {
      EXPECT_LT((position(out.intermediate, kWrist) - at_hold).norm(), 1e-4);
    }
  }
}

TEST(Tracking, TeleportRepositionsAtOnceAndMakesNoVelocity) {
  TrackingLoop loop({}, kHandRate, hand(), {});
  const auto wrist = [](double t) { return Pose{Vector3(t < 1 ? 0 : 10, 1, 0), Quaternion::Identity()}; };
  run(loop, 2, 90, wrist, [&](double t, const TrackingOutput& out) {
    EXPECT_LT(to_vector(out.intermediate.joints[kIndexTip].linear_velocity).norm(), 1e-6) << t;
    const double x = position(out.intermediate, kWrist).x();
    EXPECT_TRUE(std::abs(x) < 1e-6 || std::abs(x - 10) < 1e-6) << x;
  });
  EXPECT_EQ(loop.input().counters().repositioned, 1u);
}

TEST(Tracking, ReturnFromADropoutFarAwayIsFollowedWithoutOvershoot) {
  TrackingLoop loop({}, kHandRate, hand(), {});
  std::uint64_t sequence = 0;
  double highest = 0, speed = 0;
  for (int i = 0; i < 4000; ++i) {
    const Nanoseconds now = kStart + i * kMillisecond;
    TrackingInput input;
    Skeleton sample;
    if (i % 11 == 0 && (i < 1000 || i > 3000)) {
      sample = skeleton_at({Vector3(i < 1000 ? 0 : 0.3, 1, 0), Quaternion::Identity()}, ++sequence, now);
      input.tracked = &sample;
    }
    const TrackingOutput& out = loop.step(now, input);
    highest = std::max(highest, position(out.intermediate, kWrist).x());
    speed = std::max(speed, std::abs(out.intermediate.joints[kWrist].linear_velocity[0]));
    if (i > 3200) {
      EXPECT_NEAR(position(out.intermediate, kWrist).x(), 0.3, 1e-4);
    }
  }
  EXPECT_LT(highest, 0.31);
  EXPECT_LT(speed, 20);  // the cap of the coupling to the tracker limits the speed
}

TEST(Tracking, HeadsetMountIsComposedAtTheSamplesTime) {
  TrackedInputOptions options;
  options.headset_mount_position = {0, -0.05, -0.08};
  TrackedInput input(options);
  const double speed = 1.5;  // rad/s of the head about the vertical
  const auto head_at = [&](double t) {
    return Pose{Vector3(0.2 * t, 1.6, 0), Quaternion(Eigen::AngleAxisd(speed * t, Vector3::UnitY()))};
  };
  const Pose mount{Vector3(0, -0.05, -0.08), Quaternion::Identity()};
  const Pose hand_in_world{Vector3(0.1, 1.3, -0.4), Quaternion::Identity()};
  EXPECT_FALSE([&] {
    Skeleton s = skeleton_at(hand_in_world, 1, kStart);
    s.frame = 1;
    return input.add_sample(s, kStart);
  }());
  EXPECT_EQ(input.counters().refused_mount, 1u);
  for (int i = 0; i < 20; ++i) {
    HeadPose head;
    head.valid = 1;
    head.stamp.sample_time = kStart + i * 14 * kMillisecond;
    const Pose pose = head_at(i * 0.014);
    head.position = to_wire(pose.position);
    head.orientation = to_wire(pose.orientation);
    input.add_head_pose(head, head.stamp.sample_time);
  }
  std::uint64_t sequence = 1;
  for (const double t : {0.101, 0.15, 0.2, 0.28}) {
    const Nanoseconds time = kStart + static_cast<Nanoseconds>(t * 1e9);
    Skeleton s = skeleton_at((head_at(t) * mount).inverse() * hand_in_world, ++sequence, time);
    s.frame = 1;
    ASSERT_TRUE(input.add_sample(s, time + 30 * kMillisecond));
    EXPECT_LT((input.targets(time)[1].pose.position - hand_in_world.position).norm(), 1e-4) << t;
  }
}

TEST(Tracking, ImplausibleHeadPosesDoNotReachTheSkeleton) {
  TrackingLoop loop({}, kHandRate, hand(), {});
  HeadPose head;
  head.valid = 1;
  const auto step = [&](int i, double head_x) {
    const Nanoseconds now = kStart + i * 11 * kMillisecond;
    head.stamp.sample_time = now;
    head.position[0] = head_x;
    Skeleton sample = skeleton_at(still(), static_cast<std::uint64_t>(i) + 1, now + kMillisecond);
    sample.frame = 1;
    TrackingInput input;
    input.head = &head;
    input.tracked = &sample;
    return loop.step(now + kMillisecond, input);
  };
  for (int i = 0; i < 10; ++i) step(i, 0);
  for (int i = 10; i < 30; ++i) {
    const TrackingOutput& out = step(i, i == 10 ? 1e300 : i == 11 ? -1e300 : 0);
    EXPECT_LT((position(out.intermediate, kWrist) - (still() * hand().rest_joints[kWrist]).position).norm(), 1e-6) << i;
  }
}

// A recentred XR runtime moves the head by metres between two poses. This jump is not a speed to extrapolate with.
TEST(Tracking, RecentredHeadIsNotExtrapolated) {
  TrackedInput input({});
  HeadPose head;
  head.valid = 1;
  for (int i = 0; i < 20; ++i) {
    head.stamp.sample_time = kStart + i * 11 * kMillisecond;
    head.position[0] = i < 19 ? 0 : 2;
    input.add_head_pose(head, head.stamp.sample_time);
  }
  const Nanoseconds time = head.stamp.sample_time + 8 * kMillisecond;
  Skeleton sample = skeleton_at(still(), 1, time);
  sample.frame = 1;
  ASSERT_TRUE(input.add_sample(sample, time));
  EXPECT_NEAR(input.targets(time)[1].pose.position.x(), 2 + (still() * hand().rest_joints[kWrist]).position.x(), 1e-9);
}

TEST(Tracking, AcceptsATrackerWithAnotherClockAfterAReset) {
  for (const Nanoseconds shift : {Nanoseconds{0}, -3'600'000 * kMillisecond}) {
    TrackingLoop loop({}, kHandRate, hand(), {});
    const auto step = [&](int i, Nanoseconds taken) {
      const Skeleton sample = skeleton_at(still(), static_cast<std::uint64_t>(i), taken + shift);
      TrackingInput input;
      input.tracked = &sample;
      return loop.step(kStart + i * 11 * kMillisecond, input).valid;
    };
    ASSERT_TRUE(step(1, kStart + 11 * kMillisecond));
    loop.reset(kStart + 20 * kMillisecond);
    if (shift == 0) {
      EXPECT_FALSE(step(2, kStart + 20 * kMillisecond)) << "taken before the reset";
    }
    EXPECT_TRUE(step(3, kStart + 33 * kMillisecond)) << shift;
  }
}

TEST(Tracking, ASimulatedSkeletonOfAbsurdSpeedIsRefused) {
  for (const bool turns : {false, true}) {
    TrackingLoop loop({}, kHandRate, hand(), {});
    Vector3 last = Vector3::Zero();
    for (int i = 0; i < 500; ++i) {
      const Nanoseconds now = kStart + i * kMillisecond;
      const Skeleton tracked = skeleton_at(still(), static_cast<std::uint64_t>(i) + 1, now);
      Skeleton simulated = tracked;
      simulated.stamp.sample_time = now - 5 * kMillisecond;
      if (i == 100)
        (turns ? simulated.joints[kIndexDistal].angular_velocity : simulated.joints[kIndexDistal].linear_velocity)[0] =
            1e200;
      TrackingInput input;
      input.tracked = &tracked;
      input.simulated = &simulated;
      const TrackingOutput& out = loop.step(now, input);
      for (const BoneSample& bone : out.wrench.bones) {
        ASSERT_TRUE(all_finite(bone.coupling_force) && all_finite(bone.coupling_torque) &&
                    all_finite(bone.simulated_position) && all_finite(bone.simulated_orientation) &&
                    to_vector(bone.simulated_position).norm() < 1e4)
            << i;
      }
      const JointSample& joint = out.intermediate.joints[kIndexDistal];
      ASSERT_TRUE(all_finite(joint.position) && all_finite(joint.orientation)) << i;
      last = position(out.intermediate, kIndexDistal);
    }
    EXPECT_LT((last - (still() * hand().rest_joints[kIndexDistal]).position).norm(), 1e-3);
  }
}

TEST(Tracking, RefusesASimulatedSkeletonFromTheFuture) {
  TrackingLoop loop({}, kHandRate, hand(), {});
  double largest = 0;
  for (int i = 0; i < 300; ++i) {
    const Nanoseconds now = kStart + i * kMillisecond;
    const Skeleton tracked = skeleton_at(still(), static_cast<std::uint64_t>(i) + 1, now);
    Skeleton simulated = tracked;
    if (i >= 100) {
      simulated.stamp.sample_time = now + 3'600'000 * kMillisecond;
      for (JointSample& joint : simulated.joints) joint.position[0] += 0.1;
    }
    TrackingInput input;
    input.tracked = &tracked;
    input.simulated = &simulated;
    input.wrench_requested = true;
    const TrackingOutput& out = loop.step(now, input);
    largest = std::max(largest, to_vector(out.wrench.bones[1].coupling_force).norm());
    if (i > 200) {
      EXPECT_EQ(out.wrench.simulated_valid, 0u) << "without fresh samples the copy is stale";
    }
  }
  EXPECT_LT(largest, 0.1) << "N; a copy that is 10 cm away pulls with much more";
  LoopStatus status;
  loop.fill_status(status, kStart + 300 * kMillisecond);
  const auto refused = std::find_if(status.counters.begin(), status.counters.end(),
                                    [](const NamedValue& each) { return get_text(each.name) == "refused_future"; });
  ASSERT_NE(refused, status.counters.end());
  EXPECT_EQ(refused->value, 200);
}

// A sample may be taken while the step begins. -1 means that there is none.
TEST(Tracking, TheAgeOfTheInputIsNeverNegative) {
  TrackingLoop loop({}, kHandRate, hand(), {});
  const Skeleton tracked = skeleton_at(still(), 1, kStart + 4 * kMillisecond);
  TrackingInput input;
  input.tracked = &tracked;
  loop.step(kStart, input);
  LoopStatus status;
  loop.fill_status(status, kStart);
  EXPECT_EQ(status.input_age_ms, 0);
}

// A head pose from the future would make all present ones late.
TEST(Tracking, AHeadPoseFromTheFutureIsRefused) {
  TrackedInput input({});
  HeadPose head;
  head.valid = 1;
  const auto wrist_x = [&](int i) {
    const Nanoseconds now = kStart + i * 11 * kMillisecond;
    head.stamp.sample_time = now;
    head.position[0] = i;
    input.add_head_pose(head, now);
    head.stamp.sample_time = now + 900 * kMillisecond;
    head.position[0] = 1000;
    input.add_head_pose(head, now);
    Skeleton sample = skeleton_at(still(), static_cast<std::uint64_t>(i) + 1, now);
    sample.frame = 1;
    EXPECT_TRUE(input.add_sample(sample, now));
    return input.targets(now)[1].pose.position.x();
  };
  const double first = wrist_x(0);
  for (int i = 1; i < 10; ++i) EXPECT_NEAR(wrist_x(i), first + i, 1e-9) << i;
  EXPECT_EQ(input.counters().refused_head_clock, 10u);
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
}  // namespace softhand
