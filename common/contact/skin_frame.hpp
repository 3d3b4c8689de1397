// The frame of a triangle of the skin, and how it moves with the triangle's corners.
//
// The origin is the mean of the corners a, b, c. The axes are t1 along b - a, t2 = n x t1, and the outward normal n. An
// anchor that is fixed in this frame follows the skin, and a rigid motion of the skin moves it rigidly.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "math/types.hpp"

namespace softhand {

struct SkinFrame {
  Pose pose;                        ///< of the frame in the world
  Vector3 t2, n;                    ///< axes, world
  double length;                    ///< |b - a|, m
  double twice_area;                ///< m^2
  std::array<Vector3, 3> opposite;  ///< by corner: the edge that it does not have, counter-clockwise
  // Lower limits keep the derivatives of a collapsed triangle finite.
  static constexpr double kLeastLength = 1e-6;      // m
  static constexpr double kLeastTwiceArea = 1e-10;  // m^2

  SkinFrame(const Vector3& a, const Vector3& b, const Vector3& c) : opposite{c - b, a - c, b - a} {
    const Vector3 across = opposite[2].cross(opposite[0]);
    twice_area = std::max(across.norm(), kLeastTwiceArea);
    length = std::max(opposite[2].norm(), kLeastLength);
    n = across / twice_area;
    const Vector3 t1 = opposite[2] / length;
    t2 = n.cross(t1);
    Matrix3 axes;
    axes << t1, t2, n;
    pose.position = (a + b + c) / 3;
    pose.orientation = Quaternion(axes).normalized();
  }

  /// W_j^T torque. The frame turns by sum_j W_j dx_j if the corners move by dx_j.
  Vector3 corner_force(std::size_t corner, const Vector3& torque) const {
    return (opposite[corner].dot(torque) / twice_area) * n + (along(corner) * n.dot(torque) / length) * t2;
  }
  /// W_j.
  Matrix3 turn(std::size_t corner) const {
    return opposite[corner] * (n.transpose() / twice_area) + n * (along(corner) / length * t2.transpose());
  }

 private:
  static double along(std::size_t corner) { return corner == 0 ? -1.0 : corner == 1 ? 1.0 : 0.0; }
};

}  // namespace softhand
