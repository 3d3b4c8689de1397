#include "device/landmark_lifter.hpp"

#include <Eigen/SVD>
#include <algorithm>

#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kShortestBone = 1e-4;  // m between landmarks; a shorter bone has no direction
constexpr std::array<std::size_t, 5> kPalm{0, 5, 9, 13, 17};

bool has_no_landmark(Joint joint) {
  return joint == Joint::palm || (is_metacarpal(body_of(joint)) && joint != Joint::thumb_metacarpal);
}

Landmarks landmarks_of(const JointFrames& joints) {
  Landmarks out;
  for (std::size_t i = 0; i < kLandmarkCount; ++i) out[i] = joints[slot_of(joint_of_landmark(i))].position;
  return out;
}

// Least-squares rotation of `from` (rest pose) to `to`, each about its mean. Empty if the points lie on a line.
std::optional<Quaternion> turn_between(const std::array<Vector3, kPalm.size()>& from,
                                       const std::array<Vector3, kPalm.size()>& to) {
  Vector3 from_mean = Vector3::Zero(), to_mean = Vector3::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    from_mean += from[i] / static_cast<double>(from.size());
    to_mean += to[i] / static_cast<double>(from.size());
  }
  Matrix3 covariance = Matrix3::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) covariance += (to[i] - to_mean) * (from[i] - from_mean).transpose();
  const Eigen::JacobiSVD<Matrix3> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  if (!(svd.singularValues()[1] > 1e-3 * svd.singularValues()[0]) ||
      !(svd.singularValues()[1] > kShortestBone * kShortestBone))
    return std::nullopt;
  Vector3 signs(1, 1, (svd.matrixU() * svd.matrixV().transpose()).determinant());
  return Quaternion(Matrix3(svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose())).normalized();
}

}  // namespace

Joint joint_of_landmark(std::size_t index) {
  if (index == 0) return Joint::wrist;
  if (index <= 4) return static_cast<Joint>(index + 1);  // thumb: metacarpal .. tip
  const std::size_t finger = (index - 5) / 4;
  return static_cast<Joint>(7 + 5 * finger + (index - 5) % 4);  // proximal .. tip
}

double palm_size(const Landmarks& points) {
  const Vector3 &wrist = points[0], &index = points[5], &little = points[17];
  return std::max({(index - wrist).norm(), (little - wrist).norm(), (index - little).norm()});
}

LandmarkLifter::LandmarkLifter(const HandModel& hand, Side side)
    : rest_(hand.side == side ? hand.rest_joints : mirrored(hand).rest_joints),
      radii_(hand.joint_radii),
      palm_size_(softhand::palm_size(landmarks_of(rest_))) {}

std::optional<JointFrames> LandmarkLifter::lift(const Landmarks& landmarks) const {
  std::array<Vector3, kPalm.size()> rest_palm, palm;
  for (std::size_t i = 0; i < kPalm.size(); ++i) {
    rest_palm[i] = rest_[slot_of(joint_of_landmark(kPalm[i]))].position;
    palm[i] = landmarks[kPalm[i]];
  }
  const auto turn = turn_between(rest_palm, palm);
  if (!turn) return std::nullopt;

  JointFrames out;
  // From the rest frame to the frame of the landmarks.
  const Pose hand{landmarks[0] - *turn * rest_[slot_of(Joint::wrist)].position, *turn};
  out[slot_of(Joint::wrist)] = hand * rest_[slot_of(Joint::wrist)];
  for (int finger = 0; finger < kFingerCount; ++finger) {
    const std::size_t tip = slot_of(tip_of(static_cast<Finger>(finger)));
    const std::size_t base = finger == 0 ? tip - 3 : tip - 4;  // metacarpal
    // Metacarpals start at their place in the palm. Each bone turns against its parent by the smallest rotation that
    // points it to the next landmark. This is the motion of a joint that flexes and abducts without twist.
    out[base] = hand * rest_[base];
    for (std::size_t joint = base; joint < tip; ++joint) {
      const std::size_t landmark =
          static_cast<std::size_t>(4 * finger) + (joint - base) + (finger == 0 ? 1 : 0);  // of this joint
      const Pose bone = rest_[joint].inverse() * rest_[joint + 1];
      // Only the thumb has a landmark at the start of its metacarpal.
      const Vector3 from = joint == base && finger > 0 ? out[base].position : landmarks[landmark];
      const Vector3 towards = landmarks[landmark + 1] - from;
      if (!(towards.norm() > kShortestBone)) return std::nullopt;
      const Quaternion swing = Quaternion::FromTwoVectors(out[joint].orientation * bone.position, towards);
      out[joint].orientation = (swing * out[joint].orientation).normalized();
      out[joint + 1] = out[joint] * bone;
    }
  }
  // The palm moves with the middle metacarpal.
  const std::size_t metacarpal = slot_of(Joint::middle_metacarpal);
  out[slot_of(Joint::palm)] = out[metacarpal] * (rest_[metacarpal].inverse() * rest_[slot_of(Joint::palm)]);
  return out;
}

bool LandmarkLifter::lift(const Landmarks& landmarks, Skeleton& out) const {
  const auto joints = lift(landmarks);
  if (!joints) return false;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    out.joints[j].position = to_wire((*joints)[j].position);
    out.joints[j].orientation = to_wire((*joints)[j].orientation);
    out.joints[j].radius = radii_[j];
    out.joints[j].flags = kJointValid | (has_no_landmark(static_cast<Joint>(j)) ? kJointInferred : kJointTracked);
  }
  return true;
}

bool LandmarkLifter::lift(const HandBones& bones, Skeleton& out) const {
  Landmarks points;
  points[0] = bones.wrist.position;
  for (std::size_t finger = 0; finger < kFingerCount; ++finger) {
    const auto& joints = bones.fingers[finger];
    for (std::size_t k = 0; k < 3; ++k) points[1 + 4 * finger + k] = joints[k].position;
    // Along the axis of the bone before it, in the frame of the last bone.
    points[4 + 4 * finger] = joints[2] * (0.8 * (joints[1].inverse() * joints[2].position));
  }
  if (!lift(points, out)) return false;
  for (int finger = 0; finger < kFingerCount; ++finger)
    out.joints[slot_of(tip_of(static_cast<Finger>(finger)))].flags = kJointValid | kJointInferred;
  return true;
}

}  // namespace softhand
