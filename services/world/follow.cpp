#include "world/follow.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "math/rotation.hpp"

namespace softhand {
namespace {

constexpr double kTorqueCap = 10;    // N m
constexpr double kFollowSpeed = 2;   // m/s, approach speed to a twin that is far away
constexpr double kFollowTurn = 20;   // rad/s
constexpr double kFarthest = 0.1;    // m
constexpr double kFarthestTurn = 1;  // rad

Vector3 clamped(const Vector3& v, double limit) {
  const double norm = v.norm();
  return norm > limit ? Vector3(v * (limit / norm)) : v;
}

}  // namespace

Wrench owner_wrench(const Follower& b, const Leader& a, double kappa, double step) {
  // Let k = kappa m/T^2 and b = 2 sqrt(k m) = beta m/T. The mass then cancels in every bracket.
  const double beta = 2 * std::sqrt(kappa);
  const double share = 1 / (1 + beta + kappa);
  const double reach = 2 * step / std::sqrt(kappa);  // 2 zeta sqrt(m/k), zeta = 1
  const Vector3 e = clamped(a.pose.position - b.pose.position, std::min(kFarthest, kFollowSpeed * reach));
  const Vector3 turn = clamped(rotation_log(a.pose.orientation * b.pose.orientation.conjugate()),
                               std::min(kFarthestTurn, kFollowTurn * reach));
  const Vector3 spring =
      kappa / (step * step) * (e - step * b.velocity.linear) + beta / step * (a.velocity.linear - b.velocity.linear);
  const Vector3 twist = kappa / (step * step) * (turn - step * b.velocity.angular) +
                        beta / step * (a.velocity.angular - b.velocity.angular);
  Wrench result;
  result.force = a.wrench.force + share * (b.mass * spring - (beta + kappa) * (a.wrench.force + b.mass * b.gravity));
  result.torque = a.wrench.torque + share * (b.inertia * twist - (beta + kappa) * a.wrench.torque);
  result.force = clamped(result.force, kOwnerForceCap + b.mass * b.gravity.norm());
  result.torque = clamped(result.torque, kTorqueCap);
  return result;
}

Wrench symmetric_wrench(const Follower& b, const Leader& a, double stiffness, double angular_stiffness,
                        double damping_ratio, double step) {
  const double damping = 2 * damping_ratio * std::sqrt(stiffness * b.mass);
  const double z = (step * damping + step * step * stiffness) / b.mass;
  const Vector3 e = a.pose.position - b.pose.position;
  const Vector3 turn = rotation_log(a.pose.orientation * b.pose.orientation.conjugate());
  // The damping uses one scalar inertia (the mean). The implicit solve uses the whole tensor.
  const double angular_damping = 2 * damping_ratio * std::sqrt(angular_stiffness * b.inertia.trace() / 3);
  const double angular_z = step * angular_damping + step * step * angular_stiffness;
  Wrench result;
  result.force = (stiffness * (e - step * b.velocity.linear) + damping * (a.velocity.linear - b.velocity.linear) -
                  z * b.mass * b.gravity) /
                 (1 + z);
  const Vector3 explicit_torque = angular_stiffness * (turn - step * b.velocity.angular) +
                                  angular_damping * (a.velocity.angular - b.velocity.angular);
  result.torque = b.inertia * (b.inertia + angular_z * Matrix3::Identity()).inverse() * explicit_torque;
  result.force = clamped(result.force, kOwnerForceCap + b.mass * b.gravity.norm());
  result.torque = clamped(result.torque, kTorqueCap);
  return result;
}

}  // namespace softhand
