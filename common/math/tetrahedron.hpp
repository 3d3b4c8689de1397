// The signed volume of a tetrahedron.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "math/types.hpp"

namespace softhand {

/// m^3. Positive where the edges from `a` to `b`, `c` and `d` are right-handed, negative where they are left-handed.
inline double tetrahedron_volume(const Vector3& a, const Vector3& b, const Vector3& c, const Vector3& d) { return (b - a).dot((c - a).cross(d - a)) / 6.0; }

/// The same of four of `positions`, metres.
inline double tetrahedron_volume(const std::vector<Vector3>& positions, const std::array<std::int32_t, 4>& corners) {
  const auto x = [&](std::size_t k) -> const Vector3& { return positions[static_cast<std::size_t>(corners[k])]; };
  return tetrahedron_volume(x(0), x(1), x(2), x(3));
}

/// The same of four columns of `positions`, metres.
inline double tetrahedron_volume(const Eigen::Matrix3Xd& positions, const std::array<std::int32_t, 4>& corners) {
  return tetrahedron_volume(positions.col(corners[0]), positions.col(corners[1]), positions.col(corners[2]), positions.col(corners[3]));
}

}  // namespace softhand
