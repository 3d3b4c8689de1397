// Which joints can be used of a skeleton that another process published, and which states of flexible objects.
#pragma once

#include <algorithm>
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

/// True if the state has so many nodes, and all vectors are below the limit.
inline bool is_plausible(const SoftObjectState& state, int node_count) {
  const auto is_below = [](const auto& each) { return to_vector(each).norm() < kPlausibleLimit; };  // false for NaN
  const auto count = static_cast<std::size_t>(node_count);
  return state.nodes.size() == count && state.velocities.size() == count && is_below(state.centre) &&
         is_below(state.linear_velocity) && is_below(state.hand_force) &&
         std::all_of(state.nodes.begin(), state.nodes.end(), is_below) &&
         std::all_of(state.velocities.begin(), state.velocities.end(), is_below);
}

}  // namespace softhand
