// Volume and faces of a tetrahedron.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "math/types.hpp"

namespace softhand {

/// The three corners of each face. Face k is opposite corner k. If the volume is positive, the corners turn
/// counterclockwise as seen from outside.
inline constexpr std::array<std::array<std::size_t, 3>, 4> kTetrahedronFaces{
    {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};

/// Volume in m^3. Positive if the edges from `a` to `b`, `c` and `d` are right-handed, negative if they are
/// left-handed.
inline double tetrahedron_volume(const Vector3& a, const Vector3& b, const Vector3& c, const Vector3& d) {
  return (b - a).dot((c - a).cross(d - a)) / 6.0;
}

/// The same for four of `positions`, metres.
inline double tetrahedron_volume(const std::vector<Vector3>& positions, const std::array<std::int32_t, 4>& corners) {
  const auto x = [&](std::size_t k) -> const Vector3& { return positions[static_cast<std::size_t>(corners[k])]; };
  return tetrahedron_volume(x(0), x(1), x(2), x(3));
}

/// The same for four columns of `positions`, metres.
inline double tetrahedron_volume(const Eigen::Matrix3Xd& positions, const std::array<std::int32_t, 4>& corners) {
  return tetrahedron_volume(positions.col(corners[0]), positions.col(corners[1]), positions.col(corners[2]),
                            positions.col(corners[3]));
}

}  // namespace softhand
