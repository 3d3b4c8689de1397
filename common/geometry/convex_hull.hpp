// The convex hull of a few points, built once at load.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "math/types.hpp"

namespace softhand {

struct ConvexHull {
  std::vector<Vector3> vertices;               ///< those of the input that are corners
  std::vector<std::array<int, 3>> faces;       ///< outward, counter-clockwise
  std::vector<std::array<int, 3>> neighbours;  ///< by face, the face across its edge from corner k to corner k + 1
  std::vector<Vector3> normals;                ///< unit, by face
  std::vector<double> offsets;                 ///< normal . p = offset on the face
};

/// Farthest point first, with visible faces found by flood fill. Where coplanar or collinear points make a step
/// ambiguous it starts again with all points moved by a seeded 1e-9 (then 1e-8 ... 1e-5) of the hull's size. Throws
/// std::invalid_argument when the points are not finite, fewer than four, or flatter than 1e-4 of their size.
ConvexHull convex_hull(std::span<const Vector3> points);

}  // namespace softhand
