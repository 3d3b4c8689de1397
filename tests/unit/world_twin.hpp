// A minimal hand side of the coupling: one rigid box. A spring pulls the box to a moving target, and the planes that
// the world publishes stop it. It does not use services/hand, so the tests judge only the world's scheme.
#pragma once

#include <Eigen/LU>
#include <array>
#include <cmath>
#include <span>

#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand::test {

struct TwinTarget {
  Pose pose;
  Twist velocity;
};

class Twin {
 public:
  double mass = 0.05;
  Vector3 half_extents = Vector3::Constant(0.02);
  Vector3 gravity{0, -9.81, 0};
  double grip_hz = 25;  ///< frequency of the grip's spring with the object's mass, critically damped
  Pose pose;
  Twist velocity;
  Wrench hand;  ///< of the grip on the object, in the last step

  Vector3 inertia() const {
    const Vector3 s = half_extents.cwiseAbs2();
    return mass / 3 * Vector3(s.y() + s.z(), s.x() + s.z(), s.x() + s.y());
  }
  double grip_stiffness() const { return mass * std::pow(2 * M_PI * grip_hz, 2); }

  /// One backward Euler step. `target` holds at the end of the step. `plane_age`: seconds since the planes were
  /// sampled.
  void step(double dt, const TwinTarget& target, std::span<const NeighbourPlane> planes, double plane_age) {
    const double k = grip_stiffness();
    const double b = 2 * std::sqrt(k * mass);
    const Matrix3 axes = pose.orientation.toRotationMatrix();
    const Matrix3 spin = axes * inertia().asDiagonal() * axes.transpose();
    const Matrix3 k_turn = k / mass * spin, b_turn = b / mass * spin;
    const Vector3 e = target.pose.position - pose.position;
    const Vector3 turn = rotation_log(target.pose.orientation * pose.orientation.conjugate());
    using Vector6 = Eigen::Matrix<double, 6, 1>;
    using Matrix6 = Eigen::Matrix<double, 6, 6>;
    const double k_a = std::max(1e4, (mass * gravity.norm() + 5) / 0.5e-3) / 4;  // shared by the four corners of a face
    const double b_a = 2 * std::sqrt(4 * k_a * mass) / 4;
    Vector6 u;
    u << velocity.linear, velocity.angular;
    for (int iteration = 0; iteration < 8; ++iteration) {
      Matrix6 a = Matrix6::Zero();
      Vector6 right = Vector6::Zero();
      a.topLeftCorner<3, 3>() = (mass / dt + dt * k + b) * Matrix3::Identity();
      right.head<3>() = mass / dt * velocity.linear + mass * gravity + k * e + b * target.velocity.linear;
      a.bottomRightCorner<3, 3>() = spin / dt + dt * k_turn + b_turn;
      right.tail<3>() = spin / dt * velocity.angular + k_turn * turn + b_turn * target.velocity.angular;
      for (const NeighbourPlane& plane : planes) {
        const Vector3 n = to_vector(plane.normal), v_plane = to_vector(plane.velocity);
        const Vector3 origin = to_vector(plane.point) + plane_age * v_plane;
        for (int corner = 0; corner < 8; ++corner) {
          const Vector3 r =
              axes * Vector3((corner & 1 ? 1 : -1) * half_extents.x(), (corner & 2 ? 1 : -1) * half_extents.y(),
                             (corner & 4 ? 1 : -1) * half_extents.z());
          Eigen::Matrix<double, 3, 6> j;  // velocity of the corner
          j << Matrix3::Identity(), -skew(r);
          const double gap = n.dot(pose.position + r - origin);
          const double approach = n.dot(j * u - v_plane);
          if (gap + dt * approach >= 0) continue;
          const Eigen::Matrix<double, 1, 6> jn = n.transpose() * j;
          const double damping = gap < 0 ? b_a : 0;
          a += jn.transpose() * (dt * k_a + damping) * jn;
          right += jn.transpose() * (-k_a * gap + (dt * k_a + damping) * n.dot(v_plane));
          // Friction is a drag inside the friction cone. The contact sticks, except for a creep that the grip limits.
          const double normal_force = std::max(0.0, -k_a * (gap + dt * approach) - damping * approach);
          const Matrix3 tangent = Matrix3::Identity() - n * n.transpose();
          const double slip = (tangent * (j * u - v_plane)).norm();
          const double drag = std::min(plane.friction * normal_force / std::max(slip, 1e-9), mass / dt * 10);
          a += j.transpose() * drag * tangent * j;
          right += j.transpose() * drag * tangent * v_plane;
        }
      }
      u = a.partialPivLu().solve(right);
    }
    velocity = {u.head<3>(), u.tail<3>()};
    hand.force = k * (e - dt * velocity.linear) + b * (target.velocity.linear - velocity.linear);
    hand.torque = k_turn * (turn - dt * velocity.angular) + b_turn * (target.velocity.angular - velocity.angular);
    pose = increment(pose, dt * velocity.linear, dt * velocity.angular);
  }
};

}  // namespace softhand::test
