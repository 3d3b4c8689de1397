// Convex hull of a set of points. Built once, at load.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "math/types.hpp"

namespace softhand {

struct ConvexHull {
  std::vector<Vector3> vertices;               ///< input points that are corners of the hull
  std::vector<std::array<int, 3>> faces;       ///< outward, counter-clockwise
  std::vector<std::array<int, 3>> neighbours;  ///< per face: the face across the edge from corner k to corner k + 1
  std::vector<Vector3> normals;                ///< unit, per face
  std::vector<double> offsets;                 ///< normal . p = offset on the face
};

/// Adds the farthest point first and finds the visible faces by flood fill. Coplanar or collinear points can make a
/// step ambiguous. Then the construction starts again with all points moved by a seeded 1e-9 (then 1e-8 ... 1e-5) of
/// the hull's size. Throws std::invalid_argument if the points are not finite, fewer than four, or flatter than 1e-4 of
/// their size.
ConvexHull convex_hull(std::span<const Vector3> points);

/// At most `most` of the points whose hull is nearly that of all of them: in turn the point that is farthest beyond the
/// chosen ones in one of 262 directions, until none is farther by more than a micrometre. Deterministic.
std::vector<Vector3> hull_corners(std::span<const Vector3> points, std::size_t most);

}  // namespace softhand
