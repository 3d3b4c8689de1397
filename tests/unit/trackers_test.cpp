// Recordings, generated motions and the simulated faults of the replay tracker.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <sstream>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "support/block_hand.hpp"
#include "trackers/replay/generator.hpp"
#include "trackers/replay/posture_solver.hpp"
#include "trackers/replay/recording.hpp"
#include "trackers/replay/replay_tracker.hpp"

namespace softhand {
namespace {

constexpr Nanoseconds kMillisecond = 1'000'000;

std::size_t at(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }
std::size_t at(Body body) { return static_cast<std::size_t>(index_of(body)); }

// The block hand with an opposing thumb. The thumb is rolled about its bone so that its pad faces the fingers.
HandModel opposing_hand() {
  HandModel hand = testing::block_hand();
  const Quaternion turn = Quaternion(Eigen::AngleAxisd(0.8, Vector3::UnitY())) *
                          Quaternion(Eigen::AngleAxisd(-0.5, Vector3::UnitX())) *
                          Quaternion(Eigen::AngleAxisd(1.2, Vector3::UnitZ()));
  const std::array<double, 4> depth{0, 0.046, 0.080, 0.106};
  for (std::size_t k = 0; k < 4; ++k) {
    hand.rest_joints[2 + k] = {Vector3(-0.022, -0.005, -0.022) + turn * Vector3(0, 0, -depth[k]), turn};
  }
  hand.joint_radii.fill(0.008);
  hand.bodies[at(Body::thumb_metacarpal)].joint.flexion_range = {-0.9, 0.5};
  hand.bodies[at(Body::thumb_metacarpal)].joint.abduction_range = {-0.7, 0.7};
  hand.bodies[at(Body::index_proximal)].joint.abduction_range = {-0.35, 0.35};
  return hand;
}

Vector3 pad(const HandModel& hand, Finger finger, const JointFrames& frames) {
  return frames[at(joint_of(distal_of(finger)))] * pad_in_distal(hand, finger);
}

std::string csv_row(double t, double x) {
  std::ostringstream row;
  row << t;
  for (int j = 0; j < 25; ++j) row << "," << x << "," << 0.01 * j << ",0,0,0,0,1,0.01";
  return row.str() + "\n";
}
std::string csv_header() {
  static const char* joints[] = {"wrist", "thumb-metacarpal", "thumb-phalanx-proximal", "thumb-phalanx-distal",
                                 "thumb-tip"};
  std::string header = "t_s";
  const auto add = [&header](const std::string& joint) {
    for (const char* suffix : {"px", "py", "pz", "qx", "qy", "qz", "qw", "r"}) header += "," + joint + "." + suffix;
  };
  for (const char* joint : joints) add(joint);
  for (const char* finger : {"index-finger", "middle-finger", "ring-finger", "pinky-finger"}) {
    for (const char* part : {"metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip"})
      add(std::string(finger) + "-" + part);
  }
  return header + "\n";
}
std::string error_of(const std::string& text) {
  std::istringstream in(text);
  try {
    Recording::parse(in, "hand.csv");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(Recording, ReadsJointsAndPlacesThePalm) {
  std::istringstream in(csv_header() + csv_row(5, 0.1) + csv_row(5.02, 0.3));
  const Recording recording = Recording::parse(in, "hand.csv");
  EXPECT_EQ(recording.frames().size(), 2u);
  EXPECT_NEAR(recording.duration(), 0.02, 1e-12);
  const JointFrames middle = recording.at(0.005);
  EXPECT_NEAR(middle[at(Joint::wrist)].position.x(), 0.15, 1e-12);
  EXPECT_NEAR(middle[at(Joint::little_tip)].position.y(), 0.24, 1e-12);
  EXPECT_LT((middle[0].position - 0.5 * (middle[11].position + middle[12].position)).norm(), 1e-12);
  EXPECT_NEAR(recording.radii()[at(Joint::index_tip)], 0.01, 1e-12);
}

TEST(Recording, IgnoresAByteOrderMarkBeforeTheHeader) {
  EXPECT_EQ(error_of("\xEF\xBB\xBF" + csv_header() + csv_row(0, 0.1)), "");
}

TEST(Recording, ErrorsNameFileLineColumnAndWhatWasExpected) {
  EXPECT_EQ(error_of(""), "hand.csv:1: expected a header that starts with t_s, got an empty file");
  EXPECT_NE(error_of("t_s,wrist.px\n").find("hand.csv:1: column 'wrist.py': expected, is missing"), std::string::npos);
  EXPECT_NE(error_of("t_s,elbow.px\n").find("hand.csv:1: column 'elbow.px'"), std::string::npos);
  std::string bad = csv_row(1, 0.5);
  bad.replace(bad.find("0.5"), 3, "abc");
  EXPECT_EQ(error_of(csv_header() + csv_row(0, 0) + bad),
            "hand.csv:3: column 'wrist.px': expected a finite number, got 'abc'");
  EXPECT_NE(error_of(csv_header() + csv_row(1, 0) + csv_row(1, 0)).find("hand.csv:3: column 't_s'"), std::string::npos);
  EXPECT_NE(error_of(csv_header() + "1,2,3\n").find("hand.csv:2: expected 201 columns, got 3"), std::string::npos);
  EXPECT_NE(error_of(csv_header()).find("at least one row"), std::string::npos);
}

TEST(Recording, RecordedHandHasConstantBoneLengths) {
  const std::string path = std::string(SOFTHAND_SOURCE_DIR) + "/../shared/data/quest3/right.csv";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "skipped: no data";
  const Recording recording = Recording::load(path);
  EXPECT_EQ(recording.frames().size(), 756u);
  EXPECT_NEAR(recording.start(), 20.4612, 1e-9);
  double sum = 0, square = 0;
  for (const JointFrames& frame : recording.frames()) {
    const double length =
        (frame[at(Joint::index_intermediate)].position - frame[at(Joint::index_proximal)].position).norm();
    sum += length;
    square += length * length;
  }
  const double mean = sum / 756;
  EXPECT_NEAR(mean, 0.040, 0.005);
  EXPECT_LT(std::sqrt(square / 756 - mean * mean), 0.9e-3);
  // The tracker plays every frame at its own time.
  ReplayTracker tracker(std::make_shared<Recording>(recording), {}, {});
  Skeleton sample;
  std::size_t count = 0;
  for (Nanoseconds now = 0; now < 8'600 * kMillisecond; now += kMillisecond) {
    if (!tracker.sample(now, sample)) continue;
    if (count < recording.frames().size()) {
      EXPECT_EQ(to_vector(sample.joints[1].position),
                recording.frames()[static_cast<std::size_t>(sample.stamp.sequence - 1)][1].position);
      EXPECT_NEAR(static_cast<double>(sample.stamp.sample_time) * 1e-9,
                  recording.times()[static_cast<std::size_t>(sample.stamp.sequence - 1)], 1e-9);
    }
    ++count;
  }
  EXPECT_GE(count, 750u);
}

TEST(Kinematics, RestAnglesGiveTheRestPoseAndFlexionBendsTowardsThePalm) {
  const HandModel hand = opposing_hand();
  JointAngles angles;
  angles.fill(Vector3::Zero());
  const Pose wrist{Vector3(1, 2, 3), rotation_exp(Vector3(0.3, -0.2, 0.5))};
  const JointFrames rest = forward_kinematics(hand, wrist, angles);
  for (std::size_t j = 0; j < kJointCount; ++j) {
    EXPECT_LT((rest[j].position - wrist * hand.rest_joints[j].position).norm(), 1e-12) << kJointNames[j];
  }
  angles[at(Body::index_proximal)].x() = -1;
  const JointFrames bent = forward_kinematics(hand, Pose{}, angles);
  EXPECT_LT(bent[at(Joint::index_tip)].position.y(), hand.rest_joints[at(Joint::index_tip)].position.y() - 0.05);
  for (std::size_t j = 6; j < kJointCount; ++j) {
    const Body body = body_of(static_cast<Joint>(j));
    if (joint_of(body) != static_cast<Joint>(j)) continue;
    const std::size_t parent = at(joint_of(parent_of(body)));
    EXPECT_NEAR((bent[j].position - bent[parent].position).norm(),
                (hand.rest_joints[j].position - hand.rest_joints[parent].position).norm(), 1e-12);
  }
}

TEST(PostureSolver, EveryGoalHasACorrectDerivative) {
  const HandModel hand = opposing_hand();
  const GripHand grip(hand);
  JointAngles bent;
  bent.fill(Vector3(-0.3, 0.1, 0));
  PostureSolver solver(grip, Pose{Vector3(0.02, 0.05, 0.1), rotation_exp(Vector3(0.4, -0.2, 0.3))},
                       {grip.limited(bent), JointAngles{}});
  solver.free_wrist();
  for (const Finger f : {Finger::thumb, Finger::index}) solver.free_finger(f, {0});
  solver.free_finger(Finger::middle, {0, 1});
  const std::array<PostureSolver::Goals, 5> goals{
      [](PostureSolver& s) {
        for (const std::size_t posture : {0u, 1u}) {
          const auto pad = s.pad(Finger::middle, posture);
          s.add_point_goal(20, posture, pad.body, pad.position, Vector3(0.1, 0.2, 0.3));
        }
      },
      [](PostureSolver& s) {
        const auto pad = s.pad(Finger::thumb, 0);
        s.add_direction_goal(2, 0, pad.body, pad.normal, Vector3(0.6, 0, 0.8));
      },
      [](PostureSolver& s) {
        const auto thumb = s.pad(Finger::thumb, 0), index = s.pad(Finger::index, 0);
        const Vector3 between = index.position - thumb.position, axis = between.normalized();
        s.add_residual(3, between.norm() - 0.01,
                       {by_point(0, index.body, index.position, axis), by_point(0, thumb.body, thumb.position, -axis)});
      },
      [](PostureSolver& s) {
        s.add_distance_goal(0, {Finger::index, Finger::middle}, 0.07);
      },
      [](PostureSolver& s) {
        s.add_start_goal(1.5);
        s.add_wrist_rotation_goal(3);
      }};
  for (std::size_t g = 0; g < goals.size(); ++g) {
    VectorX values = solver.values(), gradient, unused;
    for (Eigen::Index i = 0; i < values.size(); ++i) values[i] += 0.1 * std::sin(1.0 + 3.0 * static_cast<double>(i));
    EXPECT_GT(solver.evaluate(values, goals[g], gradient), 1e-4) << g;
    for (Eigen::Index i = 0; i < values.size(); ++i) {
      constexpr double kStep = 1e-6;
      VectorX up = values, down = values;
      up[i] += kStep;
      down[i] -= kStep;
      const double slope =
          (solver.evaluate(up, goals[g], unused) - solver.evaluate(down, goals[g], unused)) / (2 * kStep);
      EXPECT_NEAR(gradient[i], slope, 1e-5 * (1 + gradient.norm())) << "goal " << g << " value " << i;
    }
  }
}

// Shipped hands. One of them is mirrored.
struct ShippedHand {
  const char* file;
  bool left;
};
HandModel load(const ShippedHand& shipped) {
  const HandModel hand = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/" + shipped.file + ".hand.json");
  return shipped.left ? mirrored(hand) : hand;
}
class ShippedGrip : public ::testing::TestWithParam<ShippedHand> {};
INSTANTIATE_TEST_SUITE_P(Hands, ShippedGrip,
                         ::testing::Values(ShippedHand{"right_400", false}, ShippedHand{"right_1450", false},
                                           ShippedHand{"right_1450", true}));

// The point where the round distal phalanx touches a face with the normal -`towards`.
Vector3 touch(const HandModel& hand, Finger finger, const JointFrames& frames, const Vector3& towards) {
  const Vector3 pad_place = pad_in_distal(hand, finger);
  return frames[at(joint_of(distal_of(finger)))] * Vector3(pad_place.x(), 0, pad_place.z()) - pad_place.y() * towards;
}
// The least clearance between the object of `distance` and the capsules of all bodies from the metacarpals on. Bodies
// for which `is_excluded` is true do not count.
template <typename Distance, typename IsExcluded>
double clearance(const HandModel& hand, const JointFrames& frames, Distance distance, IsExcluded is_excluded) {
  double least = 1;
  for (std::size_t b = 2; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    if (is_excluded(body)) continue;
    const std::size_t from = at(joint_of(body)), to = at(end_joint_of(body));
    for (double s = 0; s <= 1; s += 0.1) {
      least = std::min(least, distance((1 - s) * frames[from].position + s * frames[to].position) -
                                  ((1 - s) * hand.joint_radii[from] + s * hand.joint_radii[to]));
    }
  }
  return least;
}
void expect_in_range(const HandModel& hand, const JointFrames& frames, double time) {
  for (std::size_t b = 2; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    const std::size_t joint = at(joint_of(body)), parent = at(joint_of(parent_of(body)));
    const Quaternion rest = hand.rest_joints[parent].orientation.conjugate() * hand.rest_joints[joint].orientation;
    const Vector3 angle =
        rotation_log(rest.conjugate() * frames[parent].orientation.conjugate() * frames[joint].orientation);
    const JointModel& model = hand.bodies[b].joint;
    ASSERT_GE(angle.x(), model.flexion_range[0] - 1e-6) << kBodyNames[b] << " at " << time;
    ASSERT_LE(angle.x(), model.flexion_range[1] + 1e-6) << kBodyNames[b] << " at " << time;
    ASSERT_GE(angle.y(), model.abduction_range[0] - 1e-6) << kBodyNames[b] << " at " << time;
    ASSERT_LE(angle.y(), model.abduction_range[1] + 1e-6) << kBodyNames[b] << " at " << time;
  }
}

// Checks all requirements of a pinch, in the grip's frame: origin at its middle, +Y up, -Z from thumb to index. The
// pads meet the cube at most `above` (m) from its middle. The table keeps fingertips from going lower. The pads open by
// the options' opening, or by `least_opening` (m) if the hand is too small.
void expect_pinch(const HandModel& hand, const GeneratorOptions& o, double above = 6e-3, double least_opening = 20e-3) {
  const auto motion = make_motion(hand, o);
  const double half = 0.5 * o.object_width, open = o.approach_time, shut = o.approach_time + o.close_time;
  const Pose grip_frame{to_vector(o.object_position), Quaternion(Eigen::AngleAxisd(o.yaw, Vector3::UnitY()))};
  const auto frames_at = [&](double time) {
    JointFrames frames = motion->at(time);
    for (Pose& frame : frames) frame = grip_frame.inverse() * frame;
    return frames;
  };
  const auto gap = [&](const JointFrames& frames) {
    return Vector3(touch(hand, Finger::thumb, frames, -Vector3::UnitZ()) -
                   touch(hand, Finger::index, frames, Vector3::UnitZ()));
  };
  EXPECT_GT(gap(frames_at(open)).z(), o.object_width + 2 * least_opening - 1e-3);
  EXPECT_LT(gap(frames_at(open)).z(), o.object_width + 2 * o.opening + 1e-3);
  const JointFrames grip = frames_at(shut);
  EXPECT_LT((gap(grip) - Vector3(0, 0, o.object_width - 2 * o.closing_depth)).norm(), 1e-3);
  const Vector3 thumb = touch(hand, Finger::thumb, grip, -Vector3::UnitZ()),
                index = touch(hand, Finger::index, grip, Vector3::UnitZ());
  EXPECT_LT(std::abs(thumb.x()), 1e-3);
  EXPECT_NEAR(0.5 * (thumb.y() + index.y()), 0, above);
  // The pads point at the cube's faces within 60 degrees.
  const auto normal = [&](Finger f) {
    return Vector3(grip[at(joint_of(distal_of(f)))].orientation * Vector3(0, -1, 0));
  };
  EXPECT_LT(normal(Finger::thumb).z(), -0.5);
  EXPECT_GT(normal(Finger::index).z(), 0.5);
  // The lifted object stays between the pads.
  const JointFrames lifted = frames_at(shut + o.settle_time + o.lift_time + 1);
  EXPECT_LT((gap(lifted) - Vector3(0, 0, o.object_width - 2 * o.closing_depth)).norm(), 1e-3);

  const auto cube = [&](const Vector3& p) {
    const Vector3 q = p.cwiseAbs() - Vector3::Constant(half);
    return q.cwiseMax(0.0).norm() + std::min(q.maxCoeff(), 0.0);
  };
  const auto table = [&](const Vector3& p) { return p.y() + half; };
  const auto none = [](Body) { return false; };
  const auto gripping = [](Body body) { return finger_of(body) == Finger::thumb || finger_of(body) == Finger::index; };
  const auto pads = [&](Body body) { return gripping(body) && body == distal_of(finger_of(body)); };
  for (double time = 0; time < motion->duration(); time += 0.02) {
    const JointFrames frames = frames_at(time);
    ASSERT_GT(clearance(hand, frames, table, none), 3e-3) << time;
    expect_in_range(hand, frames, time);
    if (time > shut) continue;
    ASSERT_GT(clearance(hand, frames, cube, gripping), 3e-3) << time;
    // The other bones of the gripping fingers go no deeper than the pads. Before the fingers close, nothing touches.
    ASSERT_GT(clearance(hand, frames, cube, pads), time <= open ? 3e-3 : -o.closing_depth - 1e-3) << time;
    if (time <= open) {
      ASSERT_GT(clearance(hand, frames, cube, none), 3e-3) << time;
    }
  }
}

GeneratorOptions pinch_of(double width, double yaw = 0, double tilt = 0) {
  GeneratorOptions o;
  o.object_width = width;
  o.object_position = {0.3, 0.5 * width, -0.2};
  o.yaw = yaw;
  o.tilt = tilt;
  return o;
}

TEST_P(ShippedGrip, PinchMeetsOppositeFacesAndNothingElse) { expect_pinch(load(GetParam()), pinch_of(0.04)); }
TEST_P(ShippedGrip, PinchOfASmallCube) { expect_pinch(load(GetParam()), pinch_of(0.02), 7.5e-3); }
TEST_P(ShippedGrip, PinchOfALargeCube) { expect_pinch(load(GetParam()), pinch_of(0.05), 6e-3, 10e-3); }
TEST_P(ShippedGrip, PinchFromAnotherDirection) { expect_pinch(load(GetParam()), pinch_of(0.04, 0.7)); }
TEST_P(ShippedGrip, PinchWithALeaningHand) { expect_pinch(load(GetParam()), pinch_of(0.04, -2, 0.3)); }

TEST_P(ShippedGrip, PowerGraspWrapsTheCylinder) {
  const HandModel hand = load(GetParam());
  for (const double width : {0.03, 0.04, 0.05, 0.06, 0.08}) {
    SCOPED_TRACE(width);
    GeneratorOptions o;
    o.motion = "power_grasp";
    o.object_width = width;
    o.object_position = {0.3, 0.06, -0.2};
    const auto motion = make_motion(hand, o);
    const double shut = o.approach_time + o.close_time;
    const JointFrames grip = motion->at(shut);
    const auto cylinder = [&](const Vector3& p) {
      return std::hypot(p.x() - o.object_position[0], p.z() - o.object_position[2]) - 0.5 * width;
    };
    for (int f = 0; f < kFingerCount; ++f) {
      const Finger finger = static_cast<Finger>(f);
      EXPECT_NEAR(cylinder(pad(hand, finger, grip)), -o.closing_depth, 1e-3)
          << kFingerNames[static_cast<std::size_t>(f)];
      if (finger == Finger::thumb) continue;
      // All phalanges press.
      for (int b = index_of(distal_of(finger)) - 2; b < index_of(distal_of(finger)); ++b) {
        EXPECT_LT(clearance(hand, grip, cylinder, [b](Body body) { return index_of(body) != b; }),
                  -0.2 * o.closing_depth)
            << kBodyNames[static_cast<std::size_t>(b)];
      }
    }
    const auto palm_only = [](Body body) { return !is_metacarpal(body) || finger_of(body) == Finger::thumb; };
    EXPECT_NEAR(clearance(hand, grip, cylinder, palm_only), 1e-3, 2.5e-3);
    const auto table = [](const Vector3& p) { return p.y(); };
    for (double time = 0; time <= motion->duration(); time += 0.02) {
      const JointFrames frames = motion->at(time);
      expect_in_range(hand, frames, time);
      ASSERT_GT(clearance(hand, frames, table, [](Body) { return false; }), 5e-3) << time;
      if (time > shut) continue;
      const double distance = clearance(hand, frames, cylinder, [](Body) { return false; });
      ASSERT_GT(distance, time <= o.approach_time ? 3e-3 : -o.closing_depth - 2e-3) << time;
    }
  }
}

// The same hand with a rest pose in which its fingers are flexed further.
HandModel relaxed(const HandModel& hand) {
  JointAngles more;
  more.fill(Vector3::Zero());
  for (const Finger finger : kFourFingers) {
    const std::size_t last = at(distal_of(finger));
    more[last - 2].x() = -0.45;
    more[last - 1].x() = -0.35;
    more[last].x() = -0.1;
  }
  HandModel out = hand;
  out.rest_joints = forward_kinematics(hand, Pose{}, more);
  for (std::size_t b = 2; b < kBodyCount; ++b) {
    for (double& bound : out.bodies[b].joint.flexion_range) bound -= more[b].x();
  }
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    const std::size_t joint = at(joint_of(static_cast<Body>(hand.node_body[n])));
    out.nodes[n] = out.rest_joints[joint] * (hand.rest_joints[joint].inverse() * hand.nodes[n]);
  }
  return out;
}

TEST_P(ShippedGrip, MotionsDoNotDependOnTheFlexionAtRest) {
  const HandModel hand = load(GetParam()), other = relaxed(hand);
  const auto farthest = [&](const char* name, double from, double to) {
    GeneratorOptions o;
    o.motion = name;
    const auto motion = make_motion(hand, o), same = make_motion(other, o);
    double most = 0;
    for (double time = from; time <= to; time += 0.05) {
      const JointFrames a = motion->at(time), b = same->at(time);
      for (std::size_t j = 0; j < kJointCount; ++j) most = std::max(most, (a[j].position - b[j].position).norm());
    }
    return most;
  };
  // The motions without an object start and end in the rest pose.
  EXPECT_LT(farthest("fist", 1, 9), 1e-3);
  EXPECT_LT(farthest("free_motion", 1, 9), 1e-3);
  EXPECT_LT(farthest("rub", 1, 9), 1e-3);
  EXPECT_LT(farthest("power_grasp", 1.8, 5), 5e-3) << "the closed hand";
  expect_pinch(other, pinch_of(0.04), 6e-3, 14e-3);
}

TEST_P(ShippedGrip, MotionsAreGentleInRangeAndRepeatable) {
  const HandModel hand = load(GetParam());
  for (const char* name : {"pinch", "power_grasp", "fist", "rub", "free_motion"}) {
    GeneratorOptions o;
    o.motion = name;
    const auto motion = make_motion(hand, o), again = make_motion(hand, o);
    JointFrames last = motion->at(0);
    for (double time = 0.01; time < motion->duration(); time += 0.01) {
      const JointFrames now = motion->at(time), same = again->at(time);
      expect_in_range(hand, now, time);
      for (std::size_t j = 0; j < kJointCount; ++j) {
        ASSERT_LT((now[j].position - last[j].position).norm(), 0.6 * 0.01)
            << name << " " << kJointNames[j] << " at " << time;
        ASSERT_EQ(now[j].position, same[j].position);
      }
      last = now;
    }
  }
}

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
    return (frames[at(Joint::thumb_tip)].position - frames[at(Joint::index_tip)].position).norm();
  };
  const auto heading = [&](double t) { return motion->at(t)[at(Joint::wrist)].orientation; };
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
    return (frames[at(Joint::thumb_tip)].position - frames[at(Joint::index_tip)].position).norm();
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
  const Pose a = plain->at(0)[at(Joint::wrist)], b = aside->at(0)[at(Joint::wrist)];
  EXPECT_LT((b.position - a.position - to_vector(options.start_offset)).norm(), 1e-12);
  EXPECT_NEAR(rotation_log(b.orientation * a.orientation.conjugate()).y(), 0.6, 1e-12);
  for (double t = 0.5 * options.approach_time; t < plain->duration() - options.retreat_time; t += 0.05) {
    for (std::size_t j = 0; j < kJointCount; ++j)
      ASSERT_EQ(plain->at(t)[j].position, aside->at(t)[j].position) << kJointNames[j] << " at " << t;
  }
}

TEST_P(ShippedGrip, ABracedPinchHasTheBackOfTheMiddleFingerOnTheVessel) {
  GeneratorOptions options;  // the handle of mug.toml
  options.object_position = {0, 0, 0};
  options.object_width = 0.009;
  options.object_length = 0.05;
  options.free_below = 0.02;
  options.stagger = 0.032;
  options.closing_depth = 0.012;
  options.body_distance = 0.072;
  options.body_radius = 0.04;
  options.opening = 0.004;
  options.brace_depth = 0.005;
  const HandModel hand = load(GetParam());
  const auto motion = make_motion(hand, options);
  const double held = options.approach_time + options.close_time + 0.5 * options.settle_time;
  const Vector3 to_vessel(0, 0, -1);
  const Vector3 back = touch(hand, Finger::middle, motion->at(held), to_vessel);
  EXPECT_NEAR(Vector3(0, back.y(), back.z() + 0.072).norm(), 0.035, 1e-3);
  const Vector3 open = touch(hand, Finger::middle, motion->at(options.approach_time), to_vessel);
  EXPECT_GT(Vector3(0, open.y(), open.z() + 0.072).norm(), 0.041);
}

TEST(Generator, RefusesObjectsThatTheHandCannotSpan) {
  GeneratorOptions options;
  options.object_width = 0.12;
  options.closing_depth = 0;
  HandModel small = opposing_hand();
  for (Pose& joint : small.rest_joints) joint.position *= 0.5;
  EXPECT_THROW(make_motion(small, options), std::invalid_argument);
  options.object_width = 0.01;
  options.closing_depth = 0.006;
  EXPECT_THROW(make_motion(opposing_hand(), options), std::invalid_argument);
}

// These postures meet the distances between the pads. But the pads look past the cube, or touch above it.
TEST(Generator, RefusesAPinchThatDoesNotGripAndNamesWhatIsMissing) {
  const HandModel hand = load({"right_400", false});
  const auto refusal = [&hand](double width) -> std::string {
    try {
      make_motion(hand, pinch_of(width));
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "none";
  };
  EXPECT_NE(refusal(0.08).find("the pad of the thumb is turned from its face by"), std::string::npos) << refusal(0.08);
  EXPECT_NE(refusal(0.01).find("the pads touch at a height"), std::string::npos) << refusal(0.01);
  EXPECT_EQ(refusal(0.07), "none");
}

std::shared_ptr<const Motion> free_motion() {
  GeneratorOptions options;
  options.motion = "free_motion";
  static const std::shared_ptr<const Motion> motion = make_motion(opposing_hand(), options);
  return motion;
}

std::vector<Skeleton> play(const ReplayOptions& options, double seconds, Nanoseconds step = kMillisecond) {
  ReplayTracker tracker(free_motion(), options, {3, 0}, 9);
  std::vector<Skeleton> samples;
  Skeleton sample;
  for (Nanoseconds now = 0; now < static_cast<Nanoseconds>(seconds * 1e9); now += step) {
    if (tracker.sample(500 * kMillisecond + now, sample)) samples.push_back(sample);
  }
  return samples;
}

TEST(ReplayTracker, HasTheRequestedRateLatencyAndIdentity) {
  ReplayOptions options;
  options.rate_hz = 60;
  options.latency = 0.03;
  const auto samples = play(options, 2);
  EXPECT_NEAR(static_cast<double>(samples.size()), 60 * 1.97, 1.5);
  EXPECT_EQ(samples[0].hand, (HandKey{3, 0}));
  EXPECT_EQ(samples[0].source, 9u);
  EXPECT_EQ(samples[0].stamp.sample_time, 500 * kMillisecond);
  for (std::size_t i = 1; i < samples.size(); ++i) {
    EXPECT_EQ(samples[i].stamp.sequence, samples[i - 1].stamp.sequence + 1);
    EXPECT_NEAR(static_cast<double>(samples[i].stamp.sample_time - samples[i - 1].stamp.sample_time), 1e9 / 60, 2);
  }
}

TEST(ReplayTracker, NoiseHasTheRequestedSizeAndDoesNotDependOnTheCaller) {
  ReplayOptions clean, noisy;
  clean.rate_hz = noisy.rate_hz = 100;
  noisy.position_noise = 1e-3;
  noisy.rotation_noise = 0.02;
  const auto a = play(clean, 5), b = play(noisy, 5), c = play(noisy, 5, 10 * kMillisecond);
  double square = 0, turn = 0, sum = 0;
  std::size_t count = 0;
  ASSERT_EQ(a.size(), b.size());
  ASSERT_EQ(b.size(), c.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t j = 0; j < kJointCount; ++j) {
      const Vector3 error = to_vector(b[i].joints[j].position) - to_vector(a[i].joints[j].position);
      square += error.squaredNorm();
      sum += error.sum();
      turn += rotation_log(to_quaternion(b[i].joints[j].orientation) *
                           to_quaternion(a[i].joints[j].orientation).conjugate())
                  .squaredNorm();
      count += 3;
      ASSERT_EQ(b[i].joints[j].position, c[i].joints[j].position);
    }
  }
  const auto n = static_cast<double>(count);
  EXPECT_NEAR(std::sqrt(square / n), 1e-3, 3e-5);
  EXPECT_NEAR(std::sqrt(turn / n), 0.02, 6e-4);
  EXPECT_LT(std::abs(sum / n), 2e-5);
}

TEST(ReplayTracker, FaultsOccurAtTheRequestedTimes) {
  ReplayOptions options;
  options.rate_hz = 100;
  options.teleport_at = 1;
  options.teleport_time = 0.5;
  options.nan_at = 2;
  options.nan_time = 0.25;
  options.freeze_at = 3;
  options.freeze_time = 2;
  options.flip_signs = true;
  const auto clean = play({.rate_hz = 100}, 6);
  const auto samples = play(options, 6);
  EXPECT_EQ(samples.size(), clean.size() - 200);
  int teleported = 0, nans = 0;
  for (const Skeleton& s : samples) {
    const Skeleton& c = clean[static_cast<std::size_t>(s.stamp.sequence - 1)];
    teleported += std::abs(s.joints[1].position[0] - c.joints[1].position[0]) > 9 ? 1 : 0;
    nans += std::isnan(s.joints[at(Joint::index_intermediate)].position[0]) ? 1 : 0;
    EXPECT_TRUE(all_finite(s.joints[at(Joint::index_distal)].position));
    EXPECT_EQ(s.joints[1].orientation[3] * c.joints[1].orientation[3] < 0, s.stamp.sequence % 2 == 0);
  }
  EXPECT_EQ(teleported, 50);
  EXPECT_EQ(nans, 25);
}

TEST(ReplayTracker, PlaysDropoutsAndDuplicatesAndHoldsTheLastPose) {
  ReplayOptions options;
  options.rate_hz = 100;
  options.dropout_period = 1;
  options.dropout_time = 0.3;
  EXPECT_NEAR(static_cast<double>(play(options, 4).size()), 280, 2);
  options.dropout_period = 0;
  options.duplicate = true;
  const auto twice = play(options, 1);
  ASSERT_GT(twice.size(), 190u);
  EXPECT_EQ(twice[0].stamp.sequence, twice[1].stamp.sequence);
  ReplayOptions end;
  end.rate_hz = 100;
  const auto samples = play(end, 12);
  EXPECT_EQ(samples.size(), 1200u);  // continues with the last pose
  EXPECT_EQ(samples[1100].joints[1].position, samples[1199].joints[1].position);
}

}  // namespace
}  // namespace softhand
