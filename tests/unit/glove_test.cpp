// Encoders of the simulated glove, the fingers in it, and the work of the wrenches of all bones.
#include <gtest/gtest.h>

#include <cmath>

#include "cli/wrench_work.hpp"
#include "haptics/log/glove_encoders.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

using Distal = std::array<Pose, kFingerCount>;

std::array<double, kFingerCount> read(const GloveEncoders& encoders) {
  std::array<double, kFingerCount> positions{};
  encoders.read(positions);
  return positions;
}

TEST(GloveEncoders, MeasureTheOpeningOfEachFingerAlongItsBack) {
  GloveEncoders encoders;
  std::array<double, kFingerCount> none{};
  EXPECT_FALSE(encoders.read(none));
  Distal distal;
  for (std::size_t f = 0; f < kFingerCount; ++f) distal[f].position = Vector3(0.02 * static_cast<double>(f), 0, -0.1);
  encoders.move({}, distal);
  distal[1].position += Vector3(0.003, 0.002, 0.001);                                  // the dorsal axis is +y
  distal[2].orientation = Quaternion(Eigen::AngleAxisd(-M_PI / 2, Vector3::UnitZ()));  // now it is +x
  distal[2].position += Vector3(-0.004, 0.1, 0);
  encoders.move({}, distal);
  EXPECT_NEAR(read(encoders)[0], 0, 1e-15);
  EXPECT_NEAR(read(encoders)[1], 0.002, 1e-15);
  EXPECT_NEAR(read(encoders)[2], -0.004, 1e-15);
}

TEST(GloveEncoders, MotionOfTheWholeHandIsNoMotion) {
  GloveEncoders encoders;
  Distal distal;
  for (std::size_t f = 0; f < kFingerCount; ++f) distal[f].position = Vector3(0.02 * static_cast<double>(f), 0, -0.1);
  for (int i = 0; i < 100; ++i) {
    const Pose wrist{Vector3(0.01 * i, 0.02 * i, 0), rotation_exp(0.05 * i * Vector3(1, 2, 2) / 3)};
    Distal moved;
    for (std::size_t f = 0; f < kFingerCount; ++f) moved[f] = wrist * distal[f];
    encoders.move(wrist, moved);
  }
  for (const double position : read(encoders)) EXPECT_NEAR(position, 0, 1e-12);
}

constexpr double kMillisecond = 1e-3;
// The first finger of `fingers` at `time`, which follows `target` from now on, m.
double follow(SmoothFingers& fingers, double time, double target) {
  std::array<double, kFingerCount> targets{target}, positions{};
  fingers.follow(static_cast<Nanoseconds>(time * 1e9), targets, positions);
  EXPECT_EQ(positions[1], 0);
  return positions[0];
}

TEST(SmoothFingers, FollowAStepAsACriticallyDampedSpring) {
  for (const double step : {1 * kMillisecond, 7 * kMillisecond, 20 * kMillisecond}) {
    SmoothFingers fingers;
    follow(fingers, 5 - step, 0);
    EXPECT_EQ(follow(fingers, 5, 1), 0);
    double time = 0;
    for (int i = 1; i <= 100; ++i) {
      time = i * step;
      const double phase = SmoothFingers::kFrequency * time;
      EXPECT_NEAR(follow(fingers, 5 + time, 1), 1 - (1 + phase) * std::exp(-phase), 1e-6) << step << " " << time;
    }
  }
}

// The lag of a critically damped spring is two time constants.
TEST(SmoothFingers, LagBehindAConstantSpeed) {
  SmoothFingers fingers;
  constexpr double kSpeed = 0.1;
  double time = 0, position = 0;
  for (; time < 1; time += kMillisecond) position = follow(fingers, time, kSpeed * time);
  const double lag = 2 / SmoothFingers::kFrequency + kMillisecond;  // the last target acts from now on
  EXPECT_NEAR(position, kSpeed * (time - kMillisecond - lag), 0.05 * kSpeed * lag);
}

// A sample of a tracker with noise moves a tracked finger by 0.2 mm in one step of the glove.
TEST(SmoothFingers, DoNotJumpWithATrackedHand) {
  SmoothFingers fingers;
  double last = 0, speed = 0;
  for (int i = 0; i < 2000; ++i) {
    const double noise = i / 11 % 2 == 0 ? 1e-4 : -1e-4;
    const double position = follow(fingers, i * kMillisecond, noise);
    const double new_speed = (position - last) / kMillisecond;
    if (i > 1) {
      EXPECT_LT(std::abs(new_speed - speed), 2e-3) << "m/s in one step; the tracked finger has 0.2";
    }
    last = position, speed = new_speed;
  }
}

TEST(GloveEncoders, AFingerWithNaNKeepsItsPosition) {
  GloveEncoders encoders;
  Distal distal;
  encoders.move({}, distal);
  distal[3].position.y() = 0.005;
  encoders.move({}, distal);
  const double before = read(encoders)[3];
  Distal broken = distal;
  broken[3].position.x() = std::nan("");
  encoders.move({}, broken);
  EXPECT_EQ(read(encoders)[3], before);
  encoders.move({}, distal);
  EXPECT_EQ(read(encoders)[3], before);
}

TEST(WrenchWork, IsForceTimesWayPlusTorqueTimesAngleOfTheMessageBefore) {
  WrenchWork work;
  BoneWrench w;
  BonePoses poses{};
  w.simulated_valid = 1;
  w.bones[3].coupling_force = {1, 2, 0};
  w.bones[4].coupling_torque = {0, 0, 0.5};
  work.add(w, poses);
  poses[3].position = {0.01, 0.02, 0.5e-3};
  poses[4].orientation = rotation_exp(Vector3(0, 0, 0.1));
  w.bones[3].coupling_force = {100, 0, 0};  // acts from now on
  work.add(w, poses);
  EXPECT_NEAR(work.joules(), 0.05 + 0.05, 1e-12);
  w.simulated_valid = 0;
  work.add(w, poses);
  poses[3].position.x() += 0.01;
  work.add(w, poses);  // no live simulated hand: no forces
  EXPECT_NEAR(work.joules(), 0.1, 1e-12);
}

TEST(WrenchWork, JumpsAndInvalidOrientationsDoNoWorkAndAreForgotten) {
  WrenchWork work;
  BoneWrench w;
  BonePoses poses{};
  w.simulated_valid = 1;
  w.bones[0].coupling_force = {1, 0, 0};
  w.bones[0].coupling_torque = {0, 1, 0};
  work.add(w, poses);
  poses[0].position.x() = 1;
  work.add(w, poses);
  BonePoses broken = poses;
  broken[0].orientation.coeffs().setConstant(std::nan(""));
  work.add(w, broken);
  work.add(w, poses);
  EXPECT_EQ(work.joules(), 0);
  poses[0].position.x() += 0.001;
  work.add(w, poses);
  EXPECT_NEAR(work.joules(), 1e-3, 1e-12);
}

}  // namespace
}  // namespace softhand
