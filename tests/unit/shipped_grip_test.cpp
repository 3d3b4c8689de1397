// Generated grips with the shipped hands: which pads meet the object where, and what stays clear.
#include <gtest/gtest.h>

#include <cmath>

#include "messages/convert.hpp"
#include "model/kinematics.hpp"
#include "trackers/replay/posture_solver.hpp"
#include "unit/opposing_hand.hpp"

namespace softhand::shipped_grip_test {
namespace {

using testing::free_motion;
using testing::pad;

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

// Where the skin of the distal phalanx touches a face with the normal -`towards` first. Across the face it is the mean
// place of the skin within half a millimetre of the first touch.
Vector3 touch(const HandModel& hand, Finger finger, const JointFrames& frames, const Vector3& towards) {
  constexpr double kDepth = 0.5e-3;  // m
  const std::size_t joint = slot_of(joint_of(distal_of(finger)));
  std::vector<Vector3> skin = distal_skin(hand, finger);
  double first = -1;
  for (Vector3& place : skin) {
    place = frames[joint] * place;
    first = std::max(first, place.dot(towards));
  }
  Vector3 sum = Vector3::Zero();
  double count = 0;
  for (const Vector3& place : skin) {
    if (place.dot(towards) < first - kDepth) continue;
    sum += place;
    ++count;
  }
  sum /= count;
  return sum + (first - sum.dot(towards)) * towards;
}
// The least clearance between the object of `distance` and the capsules of all bodies from the metacarpals on. Bodies
// for which `is_excluded` is true do not count.
template <typename Distance, typename IsExcluded>
double clearance(const HandModel& hand, const JointFrames& frames, Distance distance, IsExcluded is_excluded) {
  double least = 1;
  for (std::size_t b = 2; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    if (is_excluded(body)) continue;
    const std::size_t from = slot_of(joint_of(body)), to = slot_of(end_joint_of(body));
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
    const std::size_t joint = slot_of(joint_of(body)), parent = slot_of(joint_of(parent_of(body)));
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
  constexpr double kAcross = 3e-3;  // m; points of the skin are 2 mm apart, on each pad
  const auto expect_gap = [&](const Vector3& found) {
    EXPECT_NEAR(found.z(), o.object_width - 2 * o.closing_depth, 1e-3);
    EXPECT_LT(found.head<2>().norm(), kAcross);
  };
  EXPECT_GT(gap(frames_at(open)).z(), o.object_width + 2 * least_opening - 1e-3);
  EXPECT_LT(gap(frames_at(open)).z(), o.object_width + 2 * o.opening + 1e-3);
  const JointFrames grip = frames_at(shut);
  expect_gap(gap(grip));
  const Vector3 thumb = touch(hand, Finger::thumb, grip, -Vector3::UnitZ()),
                index = touch(hand, Finger::index, grip, Vector3::UnitZ());
  EXPECT_LT(std::abs(thumb.x()), kAcross);
  EXPECT_NEAR(0.5 * (thumb.y() + index.y()), 0, above);
  // The pads point at the cube's faces within 60 degrees.
  const auto normal = [&](Finger f) {
    return Vector3(grip[slot_of(joint_of(distal_of(f)))].orientation * Vector3(0, -1, 0));
  };
  EXPECT_LT(normal(Finger::thumb).z(), -0.5);
  EXPECT_GT(normal(Finger::index).z(), 0.5);
  // The lifted object stays between the pads.
  const JointFrames lifted = frames_at(shut + o.settle_time + o.lift_time + 1);
  expect_gap(gap(lifted));

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

// A left hand was asked to have its knuckles and its thumb on the other side of the cylinder.
TEST(Generator, PowerGraspsOfBothHandsAreMirrorImages) {
  const HandModel right = load({"right_1450", false}), left = mirrored(right);
  GeneratorOptions o;
  o.motion = "power_grasp";
  o.object_position = {0, 0, 0};
  const auto of_right = make_motion(right, o), of_left = make_motion(left, o);
  for (const double time : {o.approach_time, o.approach_time + o.close_time}) {
    const JointFrames a = of_right->at(time), b = of_left->at(time);
    for (std::size_t j = 0; j < kJointCount; ++j)
      EXPECT_LT((b[j].position - Vector3(-1, 1, 1).cwiseProduct(a[j].position)).norm(), 1e-3)
          << kJointNames[j] << " at " << time;
  }
}

// The same hand with a rest pose in which its fingers are flexed further.
HandModel relaxed(const HandModel& hand) {
  JointAngles more;
  more.fill(Vector3::Zero());
  for (const Finger finger : kFourFingers) {
    const std::size_t last = slot_of(distal_of(finger));
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
    const std::size_t joint = slot_of(joint_of(static_cast<Body>(hand.node_body[n])));
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

TEST_P(ShippedGrip, APinchSqueezesAfterItHasPutTheObjectDown) {
  GeneratorOptions options;
  options.object_position = {0, 0, 0};
  options.object_width = 0.056;
  options.free_below = 0.006;
  options.closing_depth = 0.0025;
  options.squeeze_depth = 0.0255;
  options.turn_angle = 0;
  const HandModel hand = load(GetParam());
  const auto motion = make_motion(hand, options);
  for (const MotionPhase& phase : motion->phases()) {
    const JointFrames frames = motion->at(phase.end);
    const double gap = touch(hand, Finger::thumb, frames, -Vector3::UnitZ()).z() -
                       touch(hand, Finger::index, frames, Vector3::UnitZ()).z();
    if (phase.name == "close" || phase.name == "place") {
      EXPECT_NEAR(gap, 0.051, 1e-3) << phase.name;
    } else if (phase.name == "squeeze") {
      EXPECT_NEAR(gap, 0.005, 1e-3);
    }
  }
  const auto phases = motion->phases();
  EXPECT_EQ(std::count_if(phases.begin(), phases.end(), [](const auto& each) { return each.name == "squeeze"; }), 1);
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
  EXPECT_NE(refusal(0.2).find("the pad of the thumb is turned from its face by"), std::string::npos) << refusal(0.2);
  EXPECT_NE(refusal(0.01).find("the pads touch at a height"), std::string::npos) << refusal(0.01);
  EXPECT_EQ(refusal(0.08), "none");
}

}  // namespace
}  // namespace softhand::shipped_grip_test
