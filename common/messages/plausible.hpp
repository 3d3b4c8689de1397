// Which joints can be used of a skeleton that another process published.
#pragma once

#include <cmath>

#include "messages/convert.hpp"

namespace softhand {

/// Lengths of positions (m) and velocities (m/s, rad/s) from this limit on are refused. No scene has them, and they
/// would overflow in a step.
inline constexpr double kPlausibleLimit = 1e4;

/// True if the joint is valid, its numbers are finite and below the limit, and its quaternion has unit length within
/// 0.01. Normalise the quaternion before use.
inline bool is_usable(const JointSample& joint) {
  // False for NaN, too.
  const auto is_below = [](const Vec3& each) { return to_vector(each).norm() < kPlausibleLimit; };
  return (joint.flags & kJointValid) != 0 && is_below(joint.position) && is_below(joint.linear_velocity) &&
         is_below(joint.angular_velocity) && std::abs(to_quaternion(joint.orientation).norm() - 1) < 0.01;
}

}  // namespace softhand
