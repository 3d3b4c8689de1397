// Generated motions: their phases, their limits, and the options that they refuse.
#include "trackers/replay/generator.hpp"

#include <gtest/gtest.h>

#include "messages/convert.hpp"
#include "unit/opposing_hand.hpp"

namespace softhand::generator_test {
namespace {

using testing::free_motion;
using testing::opposing_hand;

TEST(Generator, MotionIsContinuousAndGentle) {
  const HandModel hand = opposing_hand();
  for (const char* name : {"pinch", "power_grasp", "unscrew", "scissors", "fist", "rub", "free_motion"}) {
    GeneratorOptions options;
    options.motion = name;
    options.shake_time = 1;
    options.return_time = 1;
    options.repeats = 2;
    if (options.motion == "power_grasp") options.object_width = 0.05;
    const auto motion = make_motion(hand, options);
    JointFrames last = motion->at(0);
    for (double t = 1e-3; t < motion->duration(); t += 1e-3) {
      const JointFrames now = motion->at(t);
      for (std::size_t j = 0; j < kJointCount; ++j) {
        ASSERT_LT((now[j].position - last[j].position).norm(), 2.5e-3) << name << " " << kJointNames[j] << " at " << t;
        ASSERT_NEAR(now[j].orientation.norm(), 1, 1e-9);
      }
      last = now;
    }
  }
}

TEST(Generator, TurnLiftAndLoweringMatchTheOptions) {
  const HandModel hand = opposing_hand();
  GeneratorOptions options;
  const auto motion = make_motion(hand, options);
  const auto phases = motion->phases();
  const auto end_of = [&](const std::string& name) {
    for (const MotionPhase& p : phases) {
      if (p.name == name) return p.end;
    }
    return -1.0;
  };
  const Pose lifted = motion->at(end_of("hold"))[1], turned = motion->at(end_of("turn"))[1],
             down = motion->at(end_of("lower"))[1];
  EXPECT_NEAR(rotation_log(turned.orientation * lifted.orientation.conjugate()).norm(), options.turn_angle, 1e-9);
  EXPECT_NEAR(turned.position.y() - down.position.y(), options.lift_height + options.lower_depth, 1e-9);
  EXPECT_EQ(phases.front().begin, 0);
  for (std::size_t i = 1; i < phases.size(); ++i) EXPECT_EQ(phases[i].begin, phases[i - 1].end);
  EXPECT_EQ(phases.back().end, motion->duration());
}

TEST(Generator, UnscrewingTakesTheCapAnewForEachTurn) {
  GeneratorOptions options;
  options.motion = "unscrew";
  options.repeats = 3;
  options.return_time = 0.5;
  options.turn_angle = 1.2;
  const auto motion = make_motion(opposing_hand(), options);
  const auto gap = [&](double t) {
    const JointFrames frames = motion->at(t);
    return (frames[slot_of(Joint::thumb_tip)].position - frames[slot_of(Joint::index_tip)].position).norm();
  };
  const auto heading = [&](double t) { return motion->at(t)[slot_of(Joint::wrist)].orientation; };
  std::vector<std::string> names;
  double turned = 0;
  const double closed = gap(motion->phases()[1].end);
  for (const MotionPhase& p : motion->phases()) {
    names.push_back(p.name);
    const double angle = (heading(p.end) * heading(p.begin).conjugate()).angularDistance(Quaternion::Identity());
    EXPECT_NEAR(angle, p.name == "turn" || p.name == "return" ? 1.2 : 0, 1e-6) << p.name;
    if (p.name == "turn") {
      turned += angle;
      EXPECT_NEAR(gap(p.begin), closed, 1e-9);
      EXPECT_NEAR(gap(p.end), closed, 1e-9);
    }
    if (p.name == "return") {
      EXPECT_GT(gap(0.5 * (p.begin + p.end)), closed + 0.01) << "the fingers are open";
    }
  }
  EXPECT_NEAR(turned, 3.6, 1e-6);
  const std::vector<std::string> expected{"approach", "close",  "settle",  "turn",    "release", "return",
                                          "close",    "settle", "turn",    "release", "return",  "close",
                                          "settle",   "turn",   "release", "retreat"};
  EXPECT_EQ(names, expected);
}

TEST(Generator, ScissorsOpenAndCloseBetweenEnteringAndLeaving) {
  GeneratorOptions options;
  options.motion = "scissors";
  options.opening = 0.02;
  options.ring_opening = 0.005;
  options.repeats = 2;
  const auto motion = make_motion(opposing_hand(), options);
  const auto gap = [&](double t) {
    const JointFrames frames = motion->at(t);
    return (frames[slot_of(Joint::thumb_tip)].position - frames[slot_of(Joint::index_tip)].position).norm();
  };
  int strokes = 0;
  double entering = gap(0), shut = 0;
  for (const MotionPhase& p : motion->phases()) {
    if (p.name == "close") {
      ++strokes;
      shut = gap(p.end);
      EXPECT_GT(gap(p.begin), gap(p.end) + 0.03);
    }
  }
  EXPECT_EQ(strokes, 2);
  EXPECT_GT(entering, shut + 0.005);
  EXPECT_LT(entering, shut + 0.015);
  EXPECT_NEAR(gap(motion->duration()), entering, 1e-9);
}

TEST(Generator, TheStartChangesTheFirstHalfOfTheApproachOnly) {
  GeneratorOptions options;
  const auto plain = make_motion(opposing_hand(), options);
  options.start_offset = {0.1, 0.02, -0.05};
  options.start_turn = {0, 0.6, 0};
  const auto aside = make_motion(opposing_hand(), options);
  const Pose a = plain->at(0)[slot_of(Joint::wrist)], b = aside->at(0)[slot_of(Joint::wrist)];
  EXPECT_LT((b.position - a.position - to_vector(options.start_offset)).norm(), 1e-12);
  EXPECT_NEAR(rotation_log(b.orientation * a.orientation.conjugate()).y(), 0.6, 1e-12);
  for (double t = 0.5 * options.approach_time; t < plain->duration() - options.retreat_time; t += 0.05) {
    for (std::size_t j = 0; j < kJointCount; ++j)
      ASSERT_EQ(plain->at(t)[j].position, aside->at(t)[j].position) << kJointNames[j] << " at " << t;
  }
}

TEST(Generator, RefusesObjectsThatTheHandCannotSpan) {
  GeneratorOptions options;
  options.object_width = 0.2;
  options.closing_depth = 0;
  HandModel small = opposing_hand();
  for (Pose& joint : small.rest_joints) joint.position *= 0.5;
  EXPECT_THROW(make_motion(small, options), std::invalid_argument);
  options.object_width = 0.01;
  options.closing_depth = 0.006;
  EXPECT_THROW(make_motion(opposing_hand(), options), std::invalid_argument);
}

}  // namespace
}  // namespace softhand::generator_test
