// Scaling a hand to a user without remeshing: each bone carries its surroundings along, blended by distance.
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "model/hand_model.hpp"

namespace softhand {
namespace {

std::size_t index(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }

// The joint in whose frame a joint's offset is told.
Joint offset_frame(Joint joint) {
  if (joint == Joint::wrist) return Joint::wrist;
  if (joint == Joint::palm) return Joint::middle_metacarpal;
  const Body body = body_of(joint);
  if (joint_of(body) != joint) return joint_of(body);  // a tip
  return joint_of(parent_of(body));
}

bool keeps_metacarpal_orientation(Joint joint) {
  const Body body = body_of(joint);
  return joint_of(body) == joint && is_metacarpal(body) && body != Body::thumb_metacarpal;
}

// Point p of a bone's joint frame goes to turn * (thickness * p across the bone + length * p along it).
struct BoneMap {
  Pose old_joint;
  Pose new_joint;
  Vector3 direction;  // of the old bone, joint frame
  Quaternion turn;    // from the old bone's direction to the new one's, joint frame
  double length = 1;
  double thickness = 1;

  Vector3 local(const Vector3& p) const {
    const Vector3 along = direction * direction.dot(p);
    return turn * (length * along + thickness * (p - along));
  }
  Vector3 operator()(const Vector3& rest) const { return new_joint * local(old_joint.inverse() * rest); }
};

double distance_to_segment(const Vector3& p, const Vector3& a, const Vector3& b) {
  const Vector3 d = b - a;
  const double length = d.squaredNorm();
  const double t = length > 0 ? std::clamp((p - a).dot(d) / length, 0.0, 1.0) : 0.0;
  return (p - a - t * d).norm();
}

}  // namespace

MeasuredSkeleton measure_skeleton(std::span<const std::array<Pose, kJointCount>> frames, const std::array<double, kJointCount>& radii) {
  if (frames.empty()) throw std::invalid_argument("measure_skeleton: no frame with all joints valid");
  MeasuredSkeleton user;
  user.radii = radii;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const std::size_t parent = index(offset_frame(static_cast<Joint>(j)));
    Vector3 offset = Vector3::Zero();
    Eigen::Vector4d orientation = Eigen::Vector4d::Zero();
    for (const auto& frame : frames) {
      const Pose local = frame[parent].inverse() * frame[j];
      offset += local.position;
      const Eigen::Vector4d q = local.orientation.coeffs();
      orientation += q.dot(orientation) < 0 ? Eigen::Vector4d(-q) : q;
    }
    user.offsets[j] = offset / static_cast<double>(frames.size());
    user.metacarpal_orientations[j] =
        keeps_metacarpal_orientation(static_cast<Joint>(j)) ? Quaternion(orientation).normalized() : Quaternion::Identity();
  }
  return user;
}

HandModel fitted(const HandModel& hand, const MeasuredSkeleton& user) {
  HandModel out = hand;
  const auto old_offset = [&hand](Joint joint) {
    const Pose& frame = hand.rest_joints[index(offset_frame(joint))];
    return Vector3(frame.inverse() * hand.rest_joints[index(joint)].position);
  };

  // The new rest skeleton: the user's offsets, the model's rest orientations (metacarpals II-V: the user's, because there they are a convention).
  for (std::size_t j = 1; j < kJointCount; ++j) {
    const Joint joint = static_cast<Joint>(j);
    if (joint == Joint::wrist) continue;
    Pose& pose = out.rest_joints[j];
    const Pose& frame = out.rest_joints[index(offset_frame(joint))];
    pose.position = frame * user.offsets[j];
    if (keeps_metacarpal_orientation(joint)) pose.orientation = frame.orientation * user.metacarpal_orientations[j];
  }
  const std::size_t palm = index(Joint::palm);
  const Pose& palm_frame = out.rest_joints[index(Joint::middle_metacarpal)];
  out.rest_joints[palm].position = palm_frame * user.offsets[palm];
  out.rest_joints[palm].orientation = palm_frame.orientation * (hand.rest_joints[index(Joint::middle_metacarpal)].orientation.conjugate() *
                                                                hand.rest_joints[palm].orientation);

  std::array<BoneMap, kBodyCount> maps;
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    const std::size_t joint = index(joint_of(body));
    const std::size_t end = index(end_joint_of(body));
    BoneMap& map = maps[b];
    map.old_joint = hand.rest_joints[joint];
    map.new_joint = out.rest_joints[joint];
    map.direction = -Vector3::UnitZ();
    map.turn = Quaternion::Identity();
    if (body != Body::forearm) {
      const Vector3 before = old_offset(static_cast<Joint>(end));
      const Vector3 after = user.offsets[end];
      map.length = after.norm() / before.norm();
      if (!(map.length >= 0.5 && map.length <= 2.0)) {
        throw std::invalid_argument("fitted: bone " + std::string(kBodyNames[b]) + ": expected a length within a factor of 2 of the model's " +
                                    std::to_string(before.norm() * 1e3) + " mm, got " + std::to_string(after.norm() * 1e3) + " mm");
      }
      map.direction = before.normalized();
      map.turn = Quaternion::FromTwoVectors(before, after);
    }
    double ratio = 0;
    int count = 0;
    for (const std::size_t j : {joint, end}) {
      if (user.radii[j] > 0 && hand.joint_radii[j] > 0) {
        ratio += user.radii[j] / hand.joint_radii[j];
        ++count;
      }
    }
    map.thickness = count == 0 ? 1.0 : std::clamp(ratio / count, 0.8, 1.25);
  }
  // A carpus that stretched by itself would tear at the wrist: it is as long as the forearm's end leaves it, but as thick as the palm.
  maps[0].thickness = maps[1].thickness;

  // Nodes go with the bones around them, each by the inverse sixth power of its distance: continuous everywhere, and a neighbouring finger does not pull.
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    Vector3 moved = Vector3::Zero();
    double total = 0;
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      const Pose& joint = maps[b].old_joint;
      const double distance = distance_to_segment(hand.nodes[n], joint * hand.bodies[b].bone_start, joint * hand.bodies[b].bone_end);
      const double weight = std::pow(distance + 1e-3, -6.0);
      moved += weight * maps[b](hand.nodes[n]);
      total += weight;
    }
    out.nodes[n] = moved / total;
  }
  for (std::size_t b = 0; b < kBodyCount; ++b) {
    BodyModel& body = out.bodies[b];
    const BoneMap& map = maps[b];
    body.bone_start = map.local(body.bone_start);
    body.bone_end = map.local(body.bone_end);
    body.bone_start_radius *= map.thickness;
    body.bone_end_radius *= map.thickness;
    body.joint_from_body.position = map.local(body.joint_from_body.position);
    const double volume = map.length * map.thickness * map.thickness;
    body.mass *= volume;
    body.inertia *= volume * 0.5 * (map.length * map.length + map.thickness * map.thickness);
  }
  for (std::size_t j = 0; j < kJointCount; ++j) {
    if (user.radii[j] > 0) out.joint_radii[j] = user.radii[j];
  }
  validate(out, hand.name + " fitted to the user");
  return out;
}

}  // namespace softhand
