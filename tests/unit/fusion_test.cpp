// The composition of one hand from several sources, as plain values.
#include "trackers/fusion/fusion.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "runtime/config.hpp"
#include "support/count_allocations.hpp"
#include "support/split_hand.hpp"

namespace softhand::fusion_test {
namespace {

using testing::kFingerSource;
using testing::kWristSource;
constexpr Nanoseconds kStart = 1'000'000'000'000;
constexpr std::uint32_t kCamera = 3;
Nanoseconds clock_at(double seconds) { return kStart + static_cast<Nanoseconds>(std::llround(seconds * 1e9)); }

HandModel shipped_hand() { return load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json"); }

// A hand at `wrist` whose fingers are turned about their proximal joints by `flexion`.
JointFrames posed(const HandModel& hand, const Pose& wrist, double flexion) {
  JointAngles angles;
  angles.fill(Vector3::Zero());
  for (int f = 1; f < kFingerCount; ++f)
    angles[static_cast<std::size_t>(index_of(distal_of(static_cast<Finger>(f))) - 2)].x() = -flexion;
  return forward_kinematics(hand, wrist, angles);
}
double flexion_of(const Skeleton& hand, Joint joint = Joint::middle_proximal) {
  const auto turn = [&](Joint j) { return to_quaternion(hand.joints[slot_of(j)].orientation); };
  static const HandModel rest = shipped_hand();
  const Joint base = static_cast<Joint>(index_of(joint) - 1);
  const Quaternion against =
      rest.rest_joints[slot_of(base)].orientation.conjugate() * rest.rest_joints[slot_of(joint)].orientation;
  return -rotation_log(against.conjugate() * turn(base).conjugate() * turn(joint)).x();
}

class Fusion : public ::testing::Test {
 protected:
  void start(const std::string& wrist, const std::string& fingers) {
    options_.wrist = wrist;
    options_.fingers = fingers;
    fusion_.emplace(options_, input_, parse_sources(options_, 0), hand_);
  }
  void send(Skeleton sample, double measured, double arrives) {
    sample.stamp.sample_time = clock_at(measured);
    sample.stamp.sequence = ++sequence_;
    sample.stamp.epoch = sample.hand.user;
    fusion_->add(sample, clock_at(arrives));
  }
  // Calls `each(time)` at 1 kHz from now to `end`, and composes.
  void run(double end, const std::function<void(int)>& each) {
    for (; now_ < end - 1e-9; now_ = static_cast<double>(++tick_) * 1e-3) {
      each(tick_);
      if (!fusion_->compose(clock_at(now_), out_)) continue;
      if (outputs_++ > 0) {
        for (int f = 0; f < kFingerCount; ++f) {
          const std::size_t tip = slot_of(tip_of(static_cast<Finger>(f)));
          const Vector3 moved = to_vector(out_.joints[tip].position) - to_vector(last_.joints[tip].position);
          const double elapsed = static_cast<double>(out_.stamp.sample_time - last_.stamp.sample_time) * 1e-9;
          EXPECT_GT(elapsed, 0);
          fastest_ = std::max(fastest_, moved.norm() / elapsed);
        }
      }
      last_ = out_;
    }
  }

  HandModel hand_ = shipped_hand();
  FusionOptions options_;
  TrackedInputOptions input_;
  std::optional<HandFusion> fusion_;
  Skeleton out_, last_;
  double now_ = 0, fastest_ = 0;  // s, m/s of a fingertip
  int tick_ = 0, outputs_ = 0;
  std::uint64_t sequence_ = 0;
};

// A hand that was composed, and the times of the finger samples that were known and not in doubt then, newest first.
struct Composed {
  double time;
  std::vector<double> fingers;
};

// RMS distance of the fingertips if the joint angles of each composed hand come from the best linear predictor. The
// last seven samples of a joint give six mean velocities. Each is multiplied with the first three powers of the
// predicted time, and each product has a coefficient. These are fitted to the predicted motion, apart for each
// coordinate of each joint. So no linear predictor that does not know the motion before is better. Such predictors are
// constant velocity or acceleration, and Kalman and alpha-beta filters of a joint.
double best_linear_prediction(const Motion& motion, const std::vector<Composed>& hands) {
  constexpr int kSamples = 7, kPowers = 3, kCoefficients = kPowers * (kSamples - 1);
  const auto count = static_cast<Eigen::Index>(hands.size());
  const auto angles_at = [&](double time) {
    const JointFrames joints = motion.at(time);
    std::array<Vector3, kJointCount> out{};
    for (std::size_t j = slot_of(Joint::wrist) + 1; j < kJointCount; ++j) {
      const Quaternion& parent = joints[slot_of(parent_of(static_cast<Joint>(j)))].orientation;
      out[j] = rotation_log(parent.conjugate() * joints[j].orientation);
    }
    return out;
  };
  std::vector<std::array<Vector3, kJointCount>> predicted(hands.size());
  std::vector<std::array<std::array<Vector3, kJointCount>, kSamples>> known(hands.size());
  for (std::size_t i = 0; i < hands.size(); ++i)
    for (std::size_t s = 0; s < kSamples; ++s) known[i][s] = angles_at(hands[i].fingers[s]);
  Eigen::MatrixXd features(count, kCoefficients);
  Eigen::VectorXd changes(count);
  for (std::size_t j = slot_of(Joint::wrist) + 1; j < kJointCount; ++j) {
    for (int axis = 0; axis < 3; ++axis) {
      for (Eigen::Index i = 0; i < count; ++i) {
        const auto& [time, fingers] = hands[static_cast<std::size_t>(i)];
        const auto& samples = known[static_cast<std::size_t>(i)];
        for (std::size_t s = 0; s + 1 < kSamples; ++s) {
          double feature = (samples[s][j][axis] - samples[s + 1][j][axis]) / (fingers[s] - fingers[s + 1]);
          for (int power = 0; power < kPowers; ++power)
            features(i, kPowers * static_cast<int>(s) + power) = feature *= (time - fingers[0]) / testing::kFingerDelay;
        }
        changes[i] = angles_at(time)[j][axis] - samples[0][j][axis];
      }
      const Eigen::VectorXd fitted = features * features.completeOrthogonalDecomposition().solve(changes);
      for (std::size_t i = 0; i < hands.size(); ++i)
        predicted[i][j][axis] = known[i][0][j][axis] + fitted[static_cast<Eigen::Index>(i)];
    }
  }
  testing::TipErrors errors;
  for (std::size_t i = 0; i < hands.size(); ++i) {
    const JointFrames real = motion.at(hands[i].time);
    JointFrames joints = real;  // also bone lengths are known
    for (std::size_t j = slot_of(Joint::wrist) + 1; j < kJointCount; ++j) {
      const std::size_t parent = slot_of(parent_of(static_cast<Joint>(j)));
      joints[j] = joints[parent] * Pose{(real[parent].inverse() * real[j]).position, rotation_exp(predicted[i][j])};
    }
    errors.add(testing::whole_hand(joints, 0), real);
  }
  return errors.rms();
}

// Wrist 90 Hz, fingers 60 Hz and 30 ms late, with dips of confidence. The fingers are 30 to 47 ms old when they are
// composed, and this hand opens and closes at up to 3 m/s. So prediction has a price, and a delay lowers it.
TEST_F(Fusion, ComposesARecordedHandThatWasDivided) {
  const auto motion = testing::quest_hand();
  const bool is_recorded = std::filesystem::exists(testing::recorded_hand_path());
  for (const double delay : {0.0, 0.005, 0.01, 0.015, 0.02, 0.03}) {
    options_.delay = delay;
    start("1", "2");
    std::mt19937_64 random(5);
    testing::TipErrors errors, in_use;
    TrackedInput tracking(input_);  // as the tracking loop uses the hand
    std::vector<Composed> hands;
    std::vector<double> fingers;  // newest last
    double wrist_squares = 0;
    double next_wrist = 0, next_fingers = 0;
    for (double now = 0; now < motion->duration(); now += 1e-3) {
      if (now >= next_wrist) {
        send(testing::only_wrist(motion->at(next_wrist)), next_wrist, now);
        next_wrist += 1.0 / 90;
      }
      if (now >= next_fingers + testing::kFingerDelay) {
        send(testing::doubtful_fingers(motion->at(next_fingers), next_fingers, random), next_fingers, now);
        if (!testing::in_doubt(next_fingers)) fingers.push_back(next_fingers);
        next_fingers += 1.0 / 60;
      }
      const bool is_new = fusion_->compose(clock_at(now), out_);
      if (is_new) tracking.add_sample(out_, clock_at(now));
      if (now < 0.5) continue;
      const JointFrames real = motion->at(now);
      Skeleton used;
      for (int f = 0; f < kFingerCount; ++f) {
        const Joint tip = tip_of(static_cast<Finger>(f)), distal = static_cast<Joint>(index_of(tip) - 1);
        used.joints[slot_of(tip)].position =
            to_wire(tracking.targets(clock_at(now))[static_cast<std::size_t>(index_of(body_of(distal)))].pose *
                    (real[slot_of(distal)].inverse() * real[slot_of(tip)].position));
      }
      in_use.add(used, real);
      wrist_squares +=
          (tracking.targets(clock_at(now))[1].pose.position - real[slot_of(Joint::wrist)].position).squaredNorm();
      if (!is_new) continue;
      hands.push_back({static_cast<double>(out_.stamp.sample_time - kStart) * 1e-9, {}});
      hands.back().fingers.assign(fingers.rbegin(), fingers.rend());
      errors.add(out_, motion->at(hands.back().time));
      for (const JointSample& joint : out_.joints) EXPECT_EQ(joint.flags, kJointValid | kJointTracked);
    }
    const double best = best_linear_prediction(*motion, hands);
    std::printf(
        "delay %2.0f ms: fingertips %.1f mm RMS, %.0f mm at most, best linear prediction %.1f mm RMS; at the time of "
        "use: fingertips %.1f mm RMS, wrist %.1f mm RMS; %d samples, %llu poor ones\n",
        delay * 1e3, errors.rms() * 1e3, errors.largest() * 1e3, best * 1e3, in_use.rms() * 1e3,
        std::sqrt(wrist_squares / in_use.samples()) * 1e3, errors.samples(),
        static_cast<unsigned long long>(fusion_->poor()));
    EXPECT_GT(errors.samples(), 300);
    EXPECT_LT(errors.rms(), delay < 0.015 ? 8.5e-3 : 6e-3);
    if (is_recorded) {
      EXPECT_LT(errors.rms(), best + 1e-3);
      // Issue 19 asks for 6 mm.
      if (delay == 0) {
        EXPECT_GT(best, 6e-3);
      }
    }
    EXPECT_GT(fusion_->poor(), 15u);
    EXPECT_EQ(fusion_->refused(), 0u);
  }
}

TEST_F(Fusion, PutsFingersOnTheWristOfAnotherSource) {
  input_.desk_mount_position = {5, 5, 5};  // of the glove: its place does not matter
  start("1", "2");
  const Pose wrist{Vector3(0.3, 1.2, -0.4), rotation_exp(Vector3(0.4, -1, 0.3))};
  const JointFrames real = posed(hand_, wrist, 0.7);
  for (int i = 0; i < 20; ++i) {
    send(testing::only_wrist(real), i * 0.01, i * 0.01);
    send(testing::only_fingers(real), i * 0.01, i * 0.01);
    ASSERT_TRUE(fusion_->compose(clock_at(i * 0.01), out_));
    EXPECT_FALSE(fusion_->compose(clock_at(i * 0.01), out_));  // nothing new
  }
  for (std::size_t j = 0; j < kJointCount; ++j) {
    EXPECT_LT((to_vector(out_.joints[j].position) - real[j].position).norm(), 1e-9) << j;
    EXPECT_LT(to_quaternion(out_.joints[j].orientation).angularDistance(real[j].orientation), 1e-7) << j;
  }
  EXPECT_EQ(out_.frame, 0u);
  EXPECT_EQ(out_.hand.side, 1u);
}

TEST_F(Fusion, AJointHasTheConfidenceOfItsSource) {
  start("1", "2");
  const JointFrames real = posed(hand_, {}, 0.3);
  const auto compose = [&](double time, double of_the_tip) {
    Skeleton wrist = testing::only_wrist(real), fingers = testing::only_fingers(real);
    wrist.joints[slot_of(Joint::wrist)].confidence = 0.9;
    for (JointSample& joint : fingers.joints) joint.confidence = 0.7;
    fingers.joints[slot_of(Joint::index_tip)].confidence = of_the_tip;
    send(wrist, time, time);
    send(fingers, time, time);
    return fusion_->compose(clock_at(time), out_);
  };
  ASSERT_TRUE(compose(0, 0.2));
  EXPECT_EQ(out_.joints[slot_of(Joint::wrist)].confidence, 0.9);
  EXPECT_EQ(out_.joints[slot_of(Joint::index_tip)].confidence, 0.2);
  EXPECT_EQ(out_.joints[slot_of(Joint::middle_tip)].confidence, 0.7);
  for (const double bad : {std::nan(""), -1.0, 2.0}) {
    ASSERT_TRUE(compose(0.01 + std::abs(std::isnan(bad) ? 0 : bad) / 100, bad));
    EXPECT_EQ(out_.joints[slot_of(Joint::index_tip)].confidence, 1) << bad;
  }
}

// The glove dies and comes back. The camera sees the whole hand all the time, with other fingers than the glove.
TEST_F(Fusion, BridgesADeadGloveWithoutAJump) {
  start("3", "2 3");
  const JointFrames open = posed(hand_, {}, 0), closed = posed(hand_, {}, 0.6);
  bool glove = true;
  const auto sources = [&](int tick) {
    if (tick % 11 == 0) send(testing::whole_hand(open, kCamera), now_, now_);
    if (glove && tick % 5 == 0) send(testing::only_fingers(closed), now_, now_);
  };
  run(1, sources);
  EXPECT_EQ(fusion_->finger(Finger::index).owner(), kFingerSource);
  EXPECT_NEAR(flexion_of(out_), 0.6, 1e-6);

  glove = false;
  fastest_ = 0;
  run(1.07, sources);
  EXPECT_NEAR(flexion_of(out_), 0.6, 1e-6);  // held
  run(1.1, sources);
  EXPECT_EQ(fusion_->finger(Finger::index).owner(), kCamera);
  run(1.184, sources);
  EXPECT_NEAR(flexion_of(out_), 0.3, 0.06);  // half of the blend time
  run(1.5, sources);
  EXPECT_NEAR(flexion_of(out_), 0, 1e-6);

  glove = true;
  run(1.75, sources);
  EXPECT_NEAR(flexion_of(out_), 0, 1e-6);  // not yet trusted
  run(2.5, sources);
  EXPECT_NEAR(flexion_of(out_), 0.6, 1e-6);
  // A fingertip moves by 50 mm in 0.2 s, at most 1.5 times as fast as its mean. A jump would be 4 m/s and more.
  std::printf("fastest fingertip %.2f m/s\n", fastest_);
  EXPECT_GT(fastest_, 0.1);
  EXPECT_LT(fastest_, 0.45);
}

TEST_F(Fusion, BridgesADeadCameraWithAnotherWrist) {
  start("3 1", "2");
  const auto wrist_at = [](double x) { return Pose{Vector3(x, 1, 0), Quaternion::Identity()}; };
  bool camera = true;
  // Both wrists move at 0.2 m/s. They differ by 30 mm.
  const auto sources = [&](int tick) {
    if (camera && tick % 11 == 0) send(testing::whole_hand(posed(hand_, wrist_at(0.2 * now_), 0), kCamera), now_, now_);
    if (tick % 13 == 0) send(testing::only_wrist(posed(hand_, wrist_at(0.2 * now_ + 0.03), 0)), now_, now_);
    if (tick % 5 == 0) send(testing::only_fingers(posed(hand_, {}, 0.5)), now_, now_);
  };
  run(1, sources);
  EXPECT_EQ(fusion_->wrist().owner(), kCamera);
  camera = false;
  fastest_ = 0;
  run(2, sources);
  EXPECT_EQ(fusion_->wrist().owner(), kWristSource);
  EXPECT_NEAR(out_.joints[slot_of(Joint::wrist)].position[0], 0.2 * 2 + 0.03, 0.01);
  camera = true;
  run(3, sources);
  EXPECT_NEAR(out_.joints[slot_of(Joint::wrist)].position[0], 0.2 * 3, 0.01);
  EXPECT_NEAR(flexion_of(out_), 0.5, 1e-6);
  std::printf("fastest fingertip %.2f m/s\n", fastest_);
  EXPECT_LT(fastest_, 0.6);

  // No wrist at all: nothing is published, so a weaker tracker can take over.
  const int outputs = outputs_;
  run(4, [&](int tick) {
    if (tick % 5 == 0) send(testing::only_fingers(posed(hand_, {}, 0.5)), now_, now_);
  });
  EXPECT_LT(outputs_ - outputs, 50);
  EXPECT_FALSE(fusion_->wrist().owner());
}

TEST_F(Fusion, KeepsThePostureWithoutFingers) {
  start("1", "2");
  run(0.5, [&](int tick) {
    if (tick % 11 == 0) send(testing::only_wrist(posed(hand_, {}, 0)), now_, now_);
    if (tick % 11 == 0) send(testing::only_fingers(posed(hand_, {}, 0.6)), now_, now_);
  });
  fastest_ = 0;
  run(1, [&](int tick) {
    if (tick % 11 == 0) send(testing::only_wrist(posed(hand_, {}, 0)), now_, now_);
  });
  EXPECT_NEAR(flexion_of(out_), 0.6, 1e-6);
  EXPECT_EQ(out_.joints[slot_of(Joint::index_tip)].flags, kJointValid | kJointInferred);
  EXPECT_EQ(out_.joints[slot_of(Joint::wrist)].flags, kJointValid | kJointTracked);
  run(2, [&](int tick) {  // they come back with another posture
    if (tick % 11 == 0) send(testing::only_wrist(posed(hand_, {}, 0)), now_, now_);
    if (tick % 11 == 0) send(testing::only_fingers(posed(hand_, {}, 0)), now_, now_);
  });
  EXPECT_NEAR(flexion_of(out_), 0, 1e-6);
  EXPECT_LT(fastest_, 0.45);
}

TEST_F(Fusion, FollowsAPoorSourceOnlyIfNothingBetterComes) {
  start("1", "2");
  const auto wrist = [&](int tick) {
    if (tick % 11 == 0) send(testing::only_wrist(posed(hand_, {}, 0)), now_, now_);
  };
  const auto fingers = [&](int tick, double flexion, double confidence) {
    wrist(tick);
    Skeleton sample = testing::only_fingers(posed(hand_, {}, flexion));
    sample.confidence = confidence;
    if (tick % 11 == 0) send(sample, now_, now_);
  };
  run(0.5, [&](int tick) { fingers(tick, 0.5, 1); });
  fastest_ = 0;
  run(0.57, [&](int tick) { fingers(tick, 0.1, 0.2); });
  EXPECT_NEAR(flexion_of(out_), 0.5, 1e-6);
  run(1.2, [&](int tick) { fingers(tick, 0.1, 0.2); });
  EXPECT_NEAR(flexion_of(out_), 0.1, 1e-6);
  EXPECT_NEAR(out_.confidence, 0.2, 1e-12);
  EXPECT_LT(fastest_, 0.45);
  EXPECT_GT(fusion_->poor(), 50u);
}

TEST_F(Fusion, TakesEachFingerFromTheSourceThatSeesIt) {
  start("3", "2 3");
  Skeleton glove = testing::only_fingers(posed(hand_, {}, 0.6));
  for (std::size_t j = 0; j < kJointCount; ++j)
    if (j != slot_of(Joint::wrist) && finger_of(body_of(static_cast<Joint>(j))) != Finger::index)
      glove.joints[j].flags = 0;
  run(1, [&](int tick) {
    if (tick % 11 == 0) send(testing::whole_hand(posed(hand_, {}, 0.2), kCamera), now_, now_);
    if (tick % 11 == 0) send(glove, now_, now_);
  });
  EXPECT_NEAR(flexion_of(out_, Joint::index_proximal), 0.6, 1e-6);
  EXPECT_NEAR(flexion_of(out_, Joint::middle_proximal), 0.2, 1e-6);
  EXPECT_EQ(fusion_->finger(Finger::ring).owner(), kCamera);
}

TEST_F(Fusion, PutsASourceOnAHeadsetIntoTheWorld) {
  start("1", "2");
  HeadPose head;
  head.valid = 1;
  head.position = {0, 1.6, 0.2};
  Skeleton wrist = testing::only_wrist(posed(hand_, {Vector3(0, -0.3, -0.4), Quaternion::Identity()}, 0));
  wrist.frame = 1;
  send(wrist, 0.1, 0.1);
  EXPECT_EQ(fusion_->refused(), 1u);  // no head yet
  EXPECT_FALSE(fusion_->compose(clock_at(0.1), out_));
  head.stamp.sample_time = clock_at(0.11);
  fusion_->add_head(head, clock_at(0.11));
  send(wrist, 0.12, 0.12);
  ASSERT_TRUE(fusion_->compose(clock_at(0.12), out_));
  EXPECT_LT((to_vector(out_.joints[1].position) - Vector3(0, 1.3, -0.2)).norm(), 1e-9);
}

TEST_F(Fusion, IgnoresOtherUsersSidesAndBadNumbers) {
  start("1", "2");
  Skeleton other = testing::whole_hand(posed(hand_, {}, 0), 7);
  send(other, 0, 0);
  other.hand = {1, 0};
  send(other, 0, 0);
  EXPECT_FALSE(fusion_->compose(clock_at(0), out_));
  Skeleton bad = testing::whole_hand(posed(hand_, {}, 0), 1);
  for (JointSample& joint : bad.joints) joint.position[0] = std::nan("");
  send(bad, 0.01, 0.01);
  fusion_->compose(clock_at(0.01), out_);
  for (const JointSample& joint : out_.joints) EXPECT_TRUE(all_finite(joint.position));
}

TEST_F(Fusion, DoesNotAllocate) {
  start("3", "2 3");
  const Skeleton camera = testing::whole_hand(posed(hand_, {}, 0), kCamera);
  const Skeleton glove = testing::only_fingers(posed(hand_, {}, 0.6));
  counting = true;
  for (int i = 0; i < 1000; ++i) {
    send(camera, i * 0.01, i * 0.01);
    if (i / 100 % 2 == 0) send(glove, i * 0.01, i * 0.01);
    fusion_->compose(clock_at(i * 0.01), out_);
  }
  counting = false;
  EXPECT_EQ(allocations, 0);
  EXPECT_GT(fusion_->finger(Finger::index).changes(), 5u);
}

TEST(FusionOwnership, TheBestGoodSourceOwnsAndWaitsBeforeItReturns) {
  FusionOptions options;
  Ownership part({4, 5}, options);
  double time = 0;
  // Samples at 100 Hz for `seconds`: -1 none, 0 poor, 1 good.
  const auto run = [&](double seconds, int four, int five) {
    for (const double end = time + seconds; time < end; time += 0.01) {
      if (four >= 0) part.add(4, four == 1, clock_at(time));
      if (five >= 0) part.add(5, five == 1, clock_at(time));
      part.update(clock_at(time));
    }
    return part.owner().value_or(0);
  };
  EXPECT_EQ(run(0.05, -1, 1), 5u);
  EXPECT_EQ(run(0.2, 1, 1), 5u);   // 4 is better, but new
  EXPECT_EQ(run(0.2, 1, 1), 4u);   // good for 0.3 s
  EXPECT_EQ(run(0.02, 0, 1), 5u);  // poor: at once
  EXPECT_EQ(run(0.2, 1, 1), 5u);
  EXPECT_EQ(run(0.02, 1, 0), 4u);  // 5 is not good any more: no reason to wait
  EXPECT_EQ(run(0.5, 0, 0), 4u);   // both poor: the owner stays
  EXPECT_EQ(run(0.07, -1, 0), 4u);
  EXPECT_EQ(run(0.1, -1, 0), 5u);  // 4 is silent
  EXPECT_EQ(run(0.05, -1, -1), 5u);
  EXPECT_EQ(run(0.1, -1, -1), 0u);
  EXPECT_FALSE(part.owner());
  EXPECT_EQ(part.changes(), 4u);
}

TEST(FusionHead, BlendsBetweenHeadsets) {
  HeadFusion fusion(FusionOptions{}, {1, 2});
  HeadPose first, second, out;
  first.user = 1;
  second.user = 2;
  first.valid = second.valid = 1;
  second.position = {0.1, 0, 0};
  double last = 0, largest = 0;
  for (int i = 0; i < 200; ++i) {
    const Nanoseconds now = clock_at(0.01 * i);
    HeadPose& sample = i < 100 ? first : second;
    sample.stamp.sample_time = now;
    const bool is_new = fusion.add(sample, now, out);
    if (i >= 110) {
      EXPECT_TRUE(is_new) << i;
    }
    largest = std::max(largest, std::abs(out.position[0] - last));
    last = out.position[0];
  }
  EXPECT_NEAR(last, 0.1, 1e-9);
  EXPECT_LT(largest, 0.008);
  second.valid = 0;
  second.stamp.sample_time = clock_at(3);
  EXPECT_FALSE(fusion.add(second, clock_at(3), out));
  second.valid = 1;
  second.position[1] = std::nan("");
  EXPECT_FALSE(fusion.add(second, clock_at(3), out));
}

TEST(FusionHead, AHeadFromTheFutureDoesNotEndAllOthers) {
  HeadFusion fusion(FusionOptions{}, {1});
  HeadPose head, out;
  head.user = 1;
  head.valid = 1;
  head.stamp.sample_time = clock_at(3600);
  head.stamp.sequence = 70;
  EXPECT_FALSE(fusion.add(head, clock_at(1), out));
  EXPECT_EQ(fusion.refused(), 1u);
  for (std::uint64_t i = 1; i <= 3; ++i) {
    head.stamp.sample_time = clock_at(1 + 0.01 * static_cast<double>(i));
    ASSERT_TRUE(fusion.add(head, head.stamp.sample_time, out));
    EXPECT_EQ(out.stamp.sequence, i);
  }
}

TEST(FusionOptions, NameTheSourcesOfEachPart) {
  FusionOptions options;
  options.wrist = " 3  2";
  options.fingers = "2";
  options.head = "";
  const FusionSources sources = parse_sources(options, 0);
  EXPECT_EQ(sources.wrist, (std::vector<std::uint32_t>{3, 2}));
  EXPECT_EQ(sources.fingers, (std::vector<std::uint32_t>{2}));
  EXPECT_TRUE(sources.head.empty());
  for (const char* bad : {"1,2", "x", "-1", "16", "1 1", "0", "1 0"}) {
    options.wrist = bad;
    EXPECT_THROW(parse_sources(options, 0), ConfigError) << bad;
  }
}

}  // namespace
}  // namespace softhand::fusion_test
