// Wrists and heads from bodies that a tracker follows: markers, pucks, a headset.
#pragma once

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>

#include "messages/convert.hpp"
#include "messages/messages.hpp"
#include "runtime/options.hpp"

namespace softhand {

/// Where the wrist or the head is in the frame of a body that is fixed to it.
struct BodyMount {
  std::array<double, 3> position{0, 0, 0};
  std::array<double, 4> orientation{0, 0, 0, 1};

  /// Throws std::invalid_argument if the quaternion is more than 1 % from unit length.
  Pose pose() const {
    Pose out = to_pose(position, orientation);
    if (!(std::abs(out.orientation.norm() - 1) < 0.01))
      throw std::invalid_argument("orientation of a body's mount: expected a unit quaternion xyzw");
    out.orientation.normalize();
    return out;
  }
};
inline void describe(OptionVisitor& v, BodyMount& o) {
  v.numbers("position", o.position.data(), 3, "m", {-1, 1},
            "Where the wrist or the head is, in the frame of the body. A wrist has -Z towards the middle finger and +Y "
            "out of the back of the hand. A head has -Z forward and +Y up.");
  v.numbers("orientation", o.orientation.data(), 4, "1", {-1, 1}, "How it is turned there, a unit quaternion xyzw.");
}

/// Makes `out` a hand of which only the wrist is seen.
inline void set_wrist(const Pose& wrist, Skeleton& out) {
  for (JointSample& joint : out.joints) joint.flags = 0;
  JointSample& sample = out.joints[static_cast<std::size_t>(index_of(Joint::wrist))];
  sample.position = to_wire(wrist.position);
  sample.orientation = to_wire(wrist.orientation);
  sample.flags = kJointValid | kJointTracked;
  out.confidence = sample.confidence = 1;
}

/// A pose of a world whose Z axis is up, in ours, whose Y axis is up: x, y, z become x, z, -y. The axes of bodies turn
/// with those of the world, so a body that was not turned is not turned here either. `to_z_up` is the way back.
inline Pose from_z_up(const Pose& pose) {
  const auto turned = [](const Vector3& v) { return Vector3(v.x(), v.z(), -v.y()); };
  Pose out = pose;
  out.position = turned(pose.position);
  out.orientation.vec() = turned(pose.orientation.vec());
  return out;
}
inline Pose to_z_up(const Pose& pose) {
  const auto turned = [](const Vector3& v) { return Vector3(v.x(), -v.z(), v.y()); };
  Pose out = pose;
  out.position = turned(pose.position);
  out.orientation.vec() = turned(pose.orientation.vec());
  return out;
}

/// True if the numbers are a pose in a room: within 1 km, with a quaternion at most 1 % from unit length. NaN is no
/// pose. The quaternion is then normalised.
inline bool make_plausible(Pose& pose) {
  constexpr double kFarthest = 1000;  // m
  if (!(std::abs(pose.orientation.norm() - 1) < 0.01) || !(pose.position.cwiseAbs().maxCoeff() <= kFarthest))
    return false;
  pose.orientation.normalize();
  return pose.position.allFinite();
}

}  // namespace softhand
