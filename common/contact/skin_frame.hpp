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

/// The plane of a triangle of the skin. Its corners are counter-clockwise, seen from outside. Lengths in m.
struct SkinPlane {
  Vector3 middle;                                   ///< mean of the corners, world, m
  Vector3 n;                                        ///< outward normal, world
  double twice_area;                                ///< m^2
  std::array<Vector3, 3> opposite;                  ///< by corner: the edge that it does not have, counter-clockwise
  static constexpr double kLeastTwiceArea = 1e-10;  // m^2; it keeps the derivatives of a collapsed triangle finite

  SkinPlane(const Vector3& a, const Vector3& b, const Vector3& c)
      : middle((a + b + c) / 3), opposite{c - b, a - c, b - a} {
    const Vector3 across = opposite[2].cross(opposite[0]);
    twice_area = std::max(across.norm(), kLeastTwiceArea);
    n = across / twice_area;
  }

  /// Barycentric weights of the projection of `place` (world, m). Their sum is 1. Outside the triangle one is negative.
  Vector3 weights(const Vector3& place) const {
    const Vector3 from_middle = place - middle;
    Vector3 result;
    for (std::size_t k = 0; k < 3; ++k)
      result[static_cast<Eigen::Index>(k)] = 1.0 / 3 + n.cross(opposite[k]).dot(from_middle) / twice_area;
    return result;
  }
};

/// The frame of a triangle of the skin.
struct SkinFrame : SkinPlane {
  Pose pose;                                    ///< of the frame in the world
  Vector3 t2;                                   ///< axis, world
  double length;                                ///< |b - a|, m
  static constexpr double kLeastLength = 1e-6;  // m; as kLeastTwiceArea

  SkinFrame(const Vector3& a, const Vector3& b, const Vector3& c) : SkinPlane(a, b, c) {
    length = std::max(opposite[2].norm(), kLeastLength);
    const Vector3 t1 = opposite[2] / length;
    t2 = n.cross(t1);
    Matrix3 axes;
    axes << t1, t2, n;
    pose.position = middle;
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
