// Mathematical types that all libraries share. SI units, right-handed frames, +Y up, -Z forward (OpenXR).
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace softhand {

using Vector3 = Eigen::Vector3d;
using Matrix3 = Eigen::Matrix3d;
using VectorX = Eigen::VectorXd;
using Quaternion = Eigen::Quaterniond;

/// A rigid placement: maps a point p of the local frame to `position + orientation * p` of the parent frame.
struct Pose {
  Vector3 position = Vector3::Zero();               ///< metres, parent frame
  Quaternion orientation = Quaternion::Identity();  ///< unit quaternion, local to parent

  Vector3 operator*(const Vector3& point) const { return position + orientation * point; }
  Pose operator*(const Pose& local) const {
    return {position + orientation * local.position, (orientation * local.orientation).normalized()};
  }
  Pose inverse() const {
    const Quaternion back = orientation.conjugate();
    return {-(back * position), back};
  }
};

/// Velocity of a rigid body or frame, in world axes.
struct Twist {
  Vector3 linear = Vector3::Zero();   ///< metres per second, of the frame's origin
  Vector3 angular = Vector3::Zero();  ///< radians per second
};

/// Force and torque, in world axes. The owner documents the reference point of the torque.
struct Wrench {
  Vector3 force = Vector3::Zero();   ///< newtons
  Vector3 torque = Vector3::Zero();  ///< newton metres
};

}  // namespace softhand
