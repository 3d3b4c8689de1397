#include "model/joint_law.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

#include "math/rotation.hpp"

namespace softhand {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;
constexpr std::array<std::string_view, 5> kNames{"fixed", "hinge", "slider", "ball", "screw"};
// Smallest w^2 + y^2 of a relative rotation. It bounds the derivative of the twist where the axes are opposed.
constexpr double kLeastTwist = 1e-6;

// The derivative of the twist by a rotation of the child's frame, in the parent's frame:
// (x y - w z, w^2 + y^2, y z + w x)/(w^2 + y^2).
Vector3 twist_slope(const Quaternion& q) {
  const double n = std::max(q.w() * q.w() + q.y() * q.y(), kLeastTwist);
  return {(q.x() * q.y() - q.w() * q.z()) / n, 1, (q.y() * q.z() + q.w() * q.x()) / n};
}

}  // namespace

std::string_view to_string(ObjectJointKind kind) {
  const auto index = static_cast<std::size_t>(kind);
  return index < kNames.size() ? kNames[index] : "unknown";
}

ObjectJointKind object_joint_kind(std::string_view name) {
  const auto* found = std::find(kNames.begin(), kNames.end(), name);
  if (found == kNames.end())
    throw std::invalid_argument("kind '" + std::string(name) + "', expected fixed, hinge, slider, ball or screw");
  return static_cast<ObjectJointKind>(found - kNames.begin());
}

JointLaw::Potential JointLaw::potential(double q) const {
  const double stretch = q - rest;
  Potential sum{0.5 * stiffness * stretch * stretch, stiffness * stretch, stiffness};
  for (const Detent& well : wells()) {
    const double away = well.period > 0 ? std::remainder(q - well.at, well.period) : q - well.at;
    const double t = away / well.width, inside = 1 - t * t;
    if (!(inside > 0)) continue;
    sum.energy -= well.depth * inside * inside * inside;
    sum.slope += 6 * well.depth / well.width * t * inside * inside;
    sum.curvature += 6 * well.depth / (well.width * well.width) * inside * (1 - 5 * t * t);
  }
  return sum;
}

void check_joint_law(const JointLaw& law) {
  const auto demand = [](bool holds, const char* what, double value, const char* expected) {
    if (holds) return;
    throw std::invalid_argument(std::string(what) + " is " + std::to_string(value) + ", expected " + expected);
  };
  constexpr double kMost = 1e9;
  const auto not_negative = [](double x) { return x >= 0 && x <= kMost; };
  const bool fixed = law.kind == ObjectJointKind::fixed, ball = law.kind == ObjectJointKind::ball;
  demand(static_cast<std::size_t>(law.kind) < kNames.size(), "kind", static_cast<double>(law.kind), "0 to 4");
  if (law.kind == ObjectJointKind::screw)
    demand(std::abs(law.pitch) >= 1e-5 && std::abs(law.pitch) <= 1, "pitch", law.pitch,
           "0.00001 to 1 m per turn, or the negative of it for a left-handed screw");
  demand(not_negative(law.friction), "friction", law.friction, "0 to 1e9");
  demand(law.load_friction >= 0 && law.load_friction <= 10, "load_friction", law.load_friction, "0 to 10");
  demand(not_negative(law.damping), "damping", law.damping, "0 to 1e9");
  demand(not_negative(law.stiffness), "stiffness", law.stiffness, "0 to 1e9");
  demand(std::abs(law.rest) <= kMost, "rest", law.rest, "a finite number");
  demand(law.detent_count <= kMaxDetents, "detents", static_cast<double>(law.detent_count), "at most 8");
  demand(!(law.minimum > law.maximum) && !std::isnan(law.minimum) && !std::isnan(law.maximum), "limits", law.minimum,
         "a lower limit that is not above the upper limit");
  if (fixed)
    demand(!law.limited() && law.friction == 0 && law.load_friction == 0 && law.stiffness == 0 && law.damping == 0 &&
               law.detent_count == 0,
           "kind", 0, "no limits, friction, damping, spring or detents, because a fixed joint has no free coordinate");
  if (ball) {
    demand(law.detent_count == 0, "detents", static_cast<double>(law.detent_count), "none on a ball joint");
    demand(law.damping == 0, "damping", law.damping, "0 on a ball joint");
    if (law.limited())
      demand(law.maximum > 0 && law.maximum <= std::numbers::pi, "limits", law.maximum,
             "[0, largest angle] with an angle above 0 and at most pi on a ball joint");
  }
  if (law.kind == ObjectJointKind::hinge && law.limited())
    demand(law.maximum - law.minimum <= 6, "limits", law.maximum - law.minimum,
           "a range of at most 6 rad on a hinge, because the pose does not tell turns apart (use a screw)");
  for (const Detent& well : law.wells()) {
    demand(std::abs(well.at) <= kMost, "detents.at", well.at, "a finite number");
    demand(std::abs(well.depth) <= kMost, "detents.depth", well.depth, "a finite number");
    demand(well.width > 0 && well.width <= kMost, "detents.width", well.width, "a number above 0");
    demand(well.period == 0 || (well.period >= 2 * well.width && well.period <= kMost), "detents.period", well.period,
           "0 or at least twice the width");
  }
}

JointRow& JointRow::operator+=(const JointRow& other) {
  value += other.value;
  parent_linear += other.parent_linear;
  parent_angular += other.parent_angular;
  child_linear += other.child_linear;
  child_angular += other.child_angular;
  return *this;
}

JointRow& JointRow::operator*=(double factor) {
  value *= factor;
  parent_linear *= factor;
  parent_angular *= factor;
  child_linear *= factor;
  child_angular *= factor;
  return *this;
}

JointPose::JointPose(const Pose& parent_pose, const Pose& child_pose, const Pose& parent_from_joint,
                     const Pose& child_from_joint)
    : parent(parent_pose),
      child(child_pose),
      parent_frame(parent.orientation * parent_from_joint.orientation),
      child_frame(child.orientation * child_from_joint.orientation),
      child_arm(child.orientation * child_from_joint.position),
      lever(child.position + child_arm - parent.position),
      parent_arm(parent.orientation * parent_from_joint.position),
      relative(parent_frame.conjugate() * child_frame) {}

JointRow JointPose::offset(int axis) const {
  const Vector3 a = parent_frame * Vector3(Vector3::Unit(axis));
  return {a.dot(lever - parent_arm), -a, -lever.cross(a), a, child_arm.cross(a)};
}

JointRow JointPose::twist() const {
  JointRow row;
  row.value = std::remainder(2 * std::atan2(relative.y(), relative.w()), kTurn);
  row.child_angular = parent_frame * twist_slope(relative);
  row.parent_angular = -row.child_angular;
  return row;
}

Matrix3 JointPose::twist_second_derivative() const {
  const double w = relative.w(), x = relative.x(), y = relative.y(), z = relative.z();
  const double n = w * w + y * y;
  if (n < kLeastTwist) return Matrix3::Zero();
  // Derivatives of the quaternion by a rotation d of the child's frame: dw = -d.v/2, dv = (w d + d x v)/2.
  const Vector3 dw = -0.5 * Vector3(x, y, z);
  const Vector3 dx = 0.5 * Vector3(w, z, -y), dy = 0.5 * Vector3(-z, w, x), dz = 0.5 * Vector3(y, -x, w);
  const Vector3 dn = 2 * (w * dw + y * dy);
  const Vector3 slope = twist_slope(relative);
  Matrix3 derivative = Matrix3::Zero();
  derivative.row(0) = (y * dx + x * dy - z * dw - w * dz - slope.x() * dn) / n;
  derivative.row(2) = (z * dy + y * dz + x * dw + w * dx - slope.z() * dn) / n;
  return 0.5 * (derivative + derivative.transpose());
}

double joint_coordinate(const JointLaw& law, const JointPose& pose) {
  const bool screw = law.kind == ObjectJointKind::screw;
  return joint_coordinate(law, pose, screw ? kTurn / law.pitch * pose.offset(1).value : 0);
}

double joint_coordinate(const JointLaw& law, const JointPose& pose, double last) {
  if (!law.has_coordinate()) return 0;
  double near = 0;
  if (law.kind == ObjectJointKind::screw) {
    near = last;
  } else if (std::isfinite(law.minimum) && std::isfinite(law.maximum)) {
    near = 0.5 * (law.minimum + law.maximum);
  } else if (law.stiffness > 0) {
    near = law.rest;
  }
  return joint_row(law, pose, near).value;
}

double held_gap(const JointLaw& law, const JointPose& pose, double q) {
  Vector3 offset(pose.offset(0).value, pose.offset(1).value, pose.offset(2).value);
  if (law.kind == ObjectJointKind::slider) offset.y() = 0;
  if (law.kind == ObjectJointKind::screw) offset.y() -= law.pitch / kTurn * q;
  return offset.norm();
}

JointRow joint_row(const JointLaw& law, const JointPose& pose, double near) {
  if (law.kind == ObjectJointKind::slider) return pose.offset(1);
  JointRow row = pose.twist();
  row.value = near + std::remainder(row.value - near, kTurn);
  return row;
}

}  // namespace softhand
