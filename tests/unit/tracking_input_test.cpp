// What the tracking loop does with the samples of trackers, headsets and the simulated hand.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numbers>
#include <random>
#include <utility>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "support/counters.hpp"
#include "unit/tracking_rig.hpp"

namespace softhand::tracking_input_test {
namespace {

using namespace testing::tracking;

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

// A first-order low-pass filter with a time constant of 50 ms, above a floor of 0.05. Its steps are those of the loop.
TEST(Tracking, ConfidenceOfAJointIsLowPassFiltered) {
  TrackedInput input({});
  std::uint64_t sequence = 0;
  double last = 1;
  const auto confidence_at = [&](int millisecond, double confidence) {
    const Nanoseconds now = kStart + millisecond * kMillisecond;
    if (millisecond % 11 == 0) {
      Skeleton sample = skeleton_at(still(), ++sequence, now);
      sample.joints[kIndexDistal].confidence = confidence;
      EXPECT_TRUE(input.add_sample(sample, now));
    }
    const auto& targets = input.targets(now);
    EXPECT_EQ(targets[7].confidence, 1) << "another joint";
    EXPECT_EQ(input.targets(now)[8].confidence, targets[8].confidence) << "no time has passed";
    EXPECT_LE(std::abs(targets[8].confidence - std::exchange(last, targets[8].confidence)), 0.02) << millisecond;
    return targets[8].confidence;
  };
  for (int i = 0; i < 110; ++i) EXPECT_EQ(confidence_at(i, 1), 1);
  for (int i = 110; i < 660; ++i)
    EXPECT_NEAR(confidence_at(i, 0.2), 0.2 + 0.8 * std::exp(-(i - 109) / 50.0), 1e-9) << i;
  for (int i = 660; i < 1650; ++i) EXPECT_GE(confidence_at(i, 0), kLeastConfidence);
  EXPECT_NEAR(last, kLeastConfidence, 1e-6);
  for (int i = 1650; i < 2640; ++i) confidence_at(i, 1);
  EXPECT_NEAR(last, 1, 1e-6);
}

TEST(Tracking, AFirstConfidenceHasNoPast) {
  TrackedInput input({});
  Skeleton sample = skeleton_at(still(), 1, kStart);
  sample.joints[kIndexDistal].confidence = 0.3;
  ASSERT_TRUE(input.add_sample(sample, kStart));
  EXPECT_EQ(input.targets(kStart)[8].confidence, 0.3);
}

TEST(Tracking, AJointWithoutAnHonestConfidenceIsRefused) {
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity(), -0.01, 1.01, 1e308}) {
    TrackedInput input({});
    ASSERT_TRUE(input.add_sample(skeleton_at(still(), 1, kStart), kStart));
    Pose moved = still();
    moved.position.x() += 0.01;
    const Nanoseconds now = kStart + 11 * kMillisecond;
    Skeleton sample = skeleton_at(moved, 2, now);
    sample.joints[kIndexDistal].confidence = bad;
    ASSERT_TRUE(input.add_sample(sample, now));
    EXPECT_EQ(input.counters().refused_nonfinite, std::isfinite(bad) ? 0u : 1u) << bad;
    EXPECT_EQ(input.counters().refused_implausible, std::isfinite(bad) ? 1u : 0u) << bad;
    EXPECT_EQ(input.counters().inferred, 1u) << bad;
    const BodyTarget& target = input.targets(now)[8];
    EXPECT_EQ(target.confidence, 1) << bad;
    EXPECT_LT((target.pose.position - (moved * hand().rest_joints[kIndexDistal]).position).norm(), 1e-9) << bad;
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

// A tracker of 90 Hz with a noise of 1 mm and 1 degree. Returns two figures of the last bone of the index finger: the
// noise at rest (m RMS per axis), and the lag (s). The lag is that of a motion of 1 Hz with an amplitude of 0.1 m.
std::pair<double, double> noise_and_lag(double cutoff) {
  TrackedInputOptions options;
  options.smoothing_cutoff = cutoff;
  double squares = 0, late = 0, speeds = 0;
  int count = 0;
  for (const double amplitude : {0.0, 0.1}) {
    TrackedInput input(options);
    std::mt19937_64 random(1);
    std::normal_distribution<double> normal;
    const auto noise = [&](double size) -> Vector3 {
      return size * Vector3(normal(random), normal(random), normal(random));
    };
    const auto angle_at = [](double time) { return 2 * std::numbers::pi * time; };
    const auto wrist_at = [&](double time) {
      return Pose{Vector3(amplitude * std::sin(angle_at(time)), 0, 0), Quaternion::Identity()};
    };
    std::uint64_t sequence = 0;
    for (int i = 0; i < 12000; ++i) {
      const Nanoseconds now = kStart + i * kMillisecond;
      const double time = i * 1e-3;
      if (time * 90 >= static_cast<double>(sequence)) {
        Skeleton sample = skeleton_at(wrist_at(time), ++sequence, now);
        for (JointSample& joint : sample.joints) {
          joint.position = to_wire(Vector3(to_vector(joint.position) + noise(1e-3)));
          joint.orientation =
              to_wire((rotation_exp(noise(std::numbers::pi / 180)) * to_quaternion(joint.orientation)).normalized());
        }
        input.add_sample(sample, now);
      }
      const Vector3 error = (wrist_at(time) * hand().rest_joints[kIndexDistal]).position -
                            input.targets(now)[static_cast<std::size_t>(index_of(Body::index_distal))].pose.position;
      if (time < 2) continue;
      if (amplitude == 0) {
        squares += error.squaredNorm();
        ++count;
      } else {
        const double speed = 2 * std::numbers::pi * amplitude * std::cos(angle_at(time));
        late += error.x() * speed;
        speeds += speed * speed;
      }
    }
  }
  return {std::sqrt(squares / (3 * count)), late / speeds};
}

TEST(Tracking, TheFilterRemovesNoiseAtRestAndAddsLittleLag) {
  const auto [raw_noise, raw_lag] = noise_and_lag(0);
  const auto [noise, lag] = noise_and_lag(0.3);
  std::printf("noise %.2f mm, lag %.1f ms; with the filter %.2f mm, %.1f ms\n", raw_noise * 1e3, raw_lag * 1e3,
              noise * 1e3, lag * 1e3);
  EXPECT_GT(raw_noise, 1e-3);
  EXPECT_LT(std::abs(raw_lag), 1e-3);
  EXPECT_LT(noise, 0.2e-3);
  EXPECT_LT(lag, 8e-3);
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

// A hand whose clock is behind publishes without a gap, but where the hand was long ago.
TEST(Tracking, RefusesASimulatedHandThatArrivesLate) {
  for (const int late_ms : {30, 50, 60'000}) {
    TrackingLoop loop({}, kHandRate, hand(), {});
    Pose held = still();
    held.position.y() += 0.004;
    BoneWrench last;
    for (int i = 0; i < 100; ++i) {
      const Nanoseconds now = kStart + i * kMillisecond;
      const auto sequence = static_cast<std::uint64_t>(i) + 1;
      const Skeleton tracked = skeleton_at(still(), sequence, now);
      const Skeleton simulated = skeleton_at(held, sequence, now - late_ms * kMillisecond);
      TrackingInput input;
      input.tracked = &tracked;
      input.simulated = &simulated;
      last = loop.step(now, input).wrench;
    }
    const bool is_used = late_ms < 40;
    EXPECT_EQ(last.simulated_valid, is_used ? 1u : 0u) << late_ms;
    EXPECT_EQ(last.bones[8].coupling_force[1] > 1, is_used) << late_ms;
    LoopStatus status;
    loop.fill_status(status, kStart + 100 * kMillisecond);
    EXPECT_EQ(testing::counter_of(status, "refused_late"), is_used ? 0 : 100) << late_ms;
  }
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

// The head may move away while nobody sees it.
TEST(Tracking, AHandInTheFrameOfAHeadsetNeedsAHeadPoseOfTheLastSecond) {
  for (const int heads : {1, 2}) {
    TrackedInput input({});
    HeadPose head;
    head.valid = 1;
    for (int i = 0; i < heads; ++i) {
      head.stamp.sample_time = kStart - i * 11 * kMillisecond;
      input.add_head_pose(head, kStart);
    }
    for (const int age_ms : {1, 999, 1001, 60'000}) {
      const Nanoseconds now = kStart + age_ms * kMillisecond;
      Skeleton sample = skeleton_at(still(), static_cast<std::uint64_t>(age_ms), now);
      sample.frame = 1;
      EXPECT_EQ(input.add_sample(sample, now), age_ms < 1000) << age_ms;
    }
    EXPECT_EQ(input.counters().refused_mount, 2u);
  }
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

}  // namespace
}  // namespace softhand::tracking_input_test
