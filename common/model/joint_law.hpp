// A joint between two rigid objects. It has a kind, a coordinate, and laws that act on the coordinate. The hand's
// solver (energies/object_joint.hpp) and the world's engine use the same functions.
//
// A joint has a frame on the parent and a frame on the child. The joint's axis is +y of both. The kind says what the
// coordinate q is.
//
// In a fixed joint nothing is free, and there is no q.
// In a hinge the rotation about the axis is free. q is the angle, rad.
// In a slider the translation along the axis is free. q is the distance, m.
// In a ball joint all rotations are free. q is the chord 2 sin(angle/2) between the two axes. Only a limit uses it.
// In a screw the rotation is free and moves the child by pitch q / (2 pi) along +y. q is the angle, rad.
//
// The angle is the twist 2 atan2(y, w) of the relative rotation (x, y, z, w) about the axis. It is finite at any
// rotation, except where the axes are opposed: there its derivative is cut off.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string_view>

#include "math/types.hpp"

namespace softhand {

enum class ObjectJointKind : std::uint32_t { fixed = 0, hinge = 1, slider = 2, ball = 3, screw = 4 };

/// Name of a kind, as in a scene file.
std::string_view to_string(ObjectJointKind kind);
/// Throws std::invalid_argument for an unknown name.
ObjectJointKind object_joint_kind(std::string_view name);

/// A well in the potential of a coordinate: U = -depth (1 - t^2)^3 with t = (q - at)/width for |t| < 1, else 0. Force
/// and stiffness are continuous. The largest force is 96/(25 sqrt 5) depth/width = 1.717 depth/width at t = 1/sqrt 5.
/// The stiffness at the bottom is 6 depth/width^2. A negative depth is a hump, for example the dome of a button.
struct Detent {
  double at = 0;      ///< m or rad
  double depth = 0;   ///< J
  double width = 1;   ///< m or rad, > 0, half the width of the well
  double period = 0;  ///< m or rad; the well repeats at this distance, at least 2 width. 0: one well
};
inline constexpr std::size_t kMaxDetents = 8;

/// Forces are in N for a slider and in N m for the other kinds. Distances are in m or rad accordingly.
struct JointLaw {
  ObjectJointKind kind = ObjectJointKind::fixed;
  double pitch = 0;  ///< m per turn; screw only, not 0
  double minimum = -std::numeric_limits<double>::infinity();
  double maximum = std::numeric_limits<double>::infinity();  ///< ball: largest angle between the axes, rad
  double friction = 0;  ///< largest force of dry friction; ball: torque about the axis of the relative rotation
  /// Dry friction per newton of the reaction force with which the joint holds its bodies together. Slider: Coulomb's
  /// coefficient, 1. Other kinds: coefficient times effective radius of the bearing, m. It adds to `friction`.
  double load_friction = 0;
  double damping = 0;    ///< N s/m or N m s/rad; hinge, slider, screw
  double stiffness = 0;  ///< of a spring about `rest`; ball: about the orientation of the scene
  double rest = 0;
  std::array<Detent, kMaxDetents> detents{};
  std::size_t detent_count = 0;

  /// True for the kinds with one coordinate: hinge, slider and screw.
  bool has_coordinate() const { return kind != ObjectJointKind::fixed && kind != ObjectJointKind::ball; }
  bool turns() const { return kind == ObjectJointKind::hinge || kind == ObjectJointKind::screw; }
  bool limited() const {
    return minimum > -std::numeric_limits<double>::infinity() || maximum < std::numeric_limits<double>::infinity();
  }
  /// Largest force or torque of dry friction at this reaction force (N) across the free direction.
  double friction_at(double reaction) const { return friction + load_friction * reaction; }
  std::span<const Detent> wells() const { return {detents.data(), detent_count}; }

  /// Potential of spring and detents at q, its slope and its curvature: U, dU/dq, d2U/dq2.
  struct Potential {
    double energy = 0;
    double slope = 0;
    double curvature = 0;
  };
  Potential potential(double q) const;
};

/// Throws std::invalid_argument with a sentence if a number of the law is out of range: the message names the member.
void check_joint_law(const JointLaw& law);

/// A coordinate as a function of the two bodies' increments. Rows are derivatives. Rotations are spatial increments.
struct JointRow {
  double value = 0;
  Vector3 parent_linear = Vector3::Zero();
  Vector3 parent_angular = Vector3::Zero();
  Vector3 child_linear = Vector3::Zero();
  Vector3 child_angular = Vector3::Zero();

  JointRow& operator+=(const JointRow& other);
  JointRow& operator*=(double factor);
  /// Rate of the value for these velocities.
  double rate(const Twist& parent, const Twist& child) const {
    return parent_linear.dot(parent.linear) + parent_angular.dot(parent.angular) + child_linear.dot(child.linear) +
           child_angular.dot(child.angular);
  }
};

/// The poses of the two bodies and of the joint's frames on them, in the world.
struct JointPose {
  JointPose(const Pose& parent, const Pose& child, const Pose& parent_from_joint, const Pose& child_from_joint);

  Pose parent, child;  ///< of the bodies, with their origin at the centre of mass
  Quaternion parent_frame, child_frame;
  Vector3 child_arm;    ///< from the child's centre to its frame, world axes
  Vector3 lever;        ///< from the parent's centre to the child's frame, world axes
  Vector3 parent_arm;   ///< from the parent's centre to its own frame, world axes
  Quaternion relative;  ///< of the child's frame in the parent's frame

  /// Place of the child's frame along axis 0..2 of the parent's frame.
  JointRow offset(int axis) const;
  /// The twist angle, in (-pi, pi].
  JointRow twist() const;
  /// Second derivative of the twist: H with 1/2 d.H d for a rotation d of the child's frame, in the parent's frame.
  Matrix3 twist_second_derivative() const;
};

/// Coordinate q of a hinge, a slider or a screw from the poses alone, and 0 for the other kinds. The turn of a hinge is
/// the one nearest to the middle of its limits, or to the rest of its spring, or to 0. The turn of a screw is the one
/// nearest to its place along the axis. A load can open a screw by more than half of its pitch. So the place gives the
/// turn only at the start.
double joint_coordinate(const JointLaw& law, const JointPose& pose);
/// The same in a later step: the turn of a screw is the one nearest to its coordinate `last` before the step.
double joint_coordinate(const JointLaw& law, const JointPose& pose, double last);
/// Distance (m) of the two frames in the directions that the joint holds, at its coordinate q.
double held_gap(const JointLaw& law, const JointPose& pose, double q);
/// The row of q, with the turn nearest to `near`.
JointRow joint_row(const JointLaw& law, const JointPose& pose, double near);

}  // namespace softhand
