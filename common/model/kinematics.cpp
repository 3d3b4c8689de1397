#include "model/kinematics.hpp"

#include <algorithm>
#include <cmath>

#include "math/rotation.hpp"

namespace softhand {
namespace {

// Flexion of the open hand's joints from the straight finger, in radians: proximal, intermediate, distal. For the
// thumb: proximal, distal.
constexpr std::array<std::array<double, 3>, kFingerCount> kOpenFlexion{{{0, -0.163909, -0.172817},
                                                                        {-0.17784, -0.261799, -0.139626},
                                                                        {-0.234995, -0.296706, -0.15708},
                                                                        {-0.277638, -0.331613, -0.174533},
                                                                        {-0.314827, -0.331613, -0.174533}}};

// Flexion of a bone against its parent at rest, radians (negative = flexed).
double rest_flexion(const HandModel& hand, Body body) {
  const Quaternion parent = hand.rest_joints[slot_of(joint_of(parent_of(body)))].orientation;
  const Vector3 along =
      parent.conjugate() * (hand.rest_joints[slot_of(joint_of(body))].orientation * Vector3(0, 0, -1));
  return std::atan2(along.y(), std::hypot(along.x(), along.z()));
}

}  // namespace

JointAngles open_hand(const HandModel& hand) {
  JointAngles angles;
  angles.fill(Vector3::Zero());
  for (int f = 0; f < kFingerCount; ++f) {
    const int last = index_of(distal_of(static_cast<Finger>(f)));
    for (int k = 0; k < 3; ++k) {
      const Body body = static_cast<Body>(last - 2 + k);
      if (is_metacarpal(body)) continue;  // the thumb's saddle joint lies across the palm and has no straight pose
      const double straight = -rest_flexion(hand, body);
      angles[static_cast<std::size_t>(last - 2 + k)].x() =
          straight + kOpenFlexion[static_cast<std::size_t>(f)][static_cast<std::size_t>(k)];
    }
  }
  return angles;
}

JointFrames forward_kinematics(const HandModel& hand, const Pose& wrist, const JointAngles& angles) {
  JointFrames out;
  const JointFrames& rest = hand.rest_joints;
  const auto ride = [&](Joint joint, Joint on) {
    out[slot_of(joint)] = out[slot_of(on)] * (rest[slot_of(on)].inverse() * rest[slot_of(joint)]);
  };
  out[slot_of(Joint::wrist)] = wrist;
  for (std::size_t b = 2; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    const Joint joint = joint_of(body);
    ride(joint, joint_of(parent_of(body)));
    Quaternion& orientation = out[slot_of(joint)].orientation;
    orientation = (orientation * rotation_exp(angles[b])).normalized();
  }
  for (int f = 0; f < kFingerCount; ++f)
    ride(tip_of(static_cast<Finger>(f)), joint_of(distal_of(static_cast<Finger>(f))));
  ride(Joint::palm, Joint::middle_metacarpal);
  return out;
}

std::vector<Vector3> distal_skin(const HandModel& hand, Finger finger) {
  constexpr double kFromJoint = 0.2;  // of the phalanx's length: skin nearer to the joint also follows the other bone
  constexpr double kNear = 2;         // radii of the tip; the palm is farther
  const auto bone_distance = [&](Finger f, const Vector3& point) {
    const Vector3& joint = hand.rest_joints[slot_of(joint_of(distal_of(f)))].position;
    const Vector3 bone = hand.rest_joints[slot_of(tip_of(f))].position - joint;
    const double share = std::clamp((point - joint).dot(bone) / bone.squaredNorm(), 0.0, 1.0);
    return (point - joint - share * bone).norm();
  };
  const Pose to_joint = hand.rest_joints[slot_of(joint_of(distal_of(finger)))].inverse();
  const std::size_t tip = slot_of(tip_of(finger));
  const double length = (to_joint * hand.rest_joints[tip].position).norm();
  std::vector<Vector3> skin;
  for (const SkinVertex& vertex : hand.skin_vertices) {
    const Vector3 place = hand.position_of(vertex), in_joint = to_joint * place;
    const double distance = bone_distance(finger, place);
    if (in_joint.z() > -kFromJoint * length || distance > kNear * hand.joint_radii[tip]) continue;
    bool nearest = true;
    for (int f = 0; f < kFingerCount; ++f) nearest &= bone_distance(static_cast<Finger>(f), place) >= distance;
    if (nearest) skin.push_back(in_joint);
  }
  return skin;
}

Vector3 pad_in_distal(const HandModel& hand, Finger finger) {
  const Body distal = distal_of(finger);
  const Joint joint = joint_of(distal), tip = tip_of(finger);
  const Pose to_joint = hand.rest_joints[slot_of(joint)].inverse();
  const double length = (to_joint * hand.rest_joints[slot_of(tip)].position).norm();
  const double radius = 0.5 * (hand.joint_radii[slot_of(joint)] + hand.joint_radii[slot_of(tip)]);
  Vector3 pad(0, -radius, -0.6 * length);
  double lowest = 0;
  for (const Vector3& x : distal_skin(hand, finger)) {
    if (x.z() < -0.9 * length || x.z() > -0.3 * length || std::abs(x.x()) > 0.6 * radius || x.y() >= lowest) continue;
    lowest = x.y();
  }
  // A mesh that does not resemble a hand (a test's block) must not move the pad away from the finger.
  if (lowest < -0.5 * radius && lowest > -1.5 * radius) pad.y() = lowest;
  return pad;
}

}  // namespace softhand
