// Distances along a surface of triangles.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "math/types.hpp"

namespace softhand {

/// Distances between vertices along the edges of a mesh. A path along edges is longer than the shortest path over the
/// triangles, by about a tenth on a mesh of good triangles.
class SurfaceDistance {
 public:
  SurfaceDistance(std::span<const Vector3> vertices, std::span<const std::array<std::int32_t, 3>> triangles);

  /// Lowers `distance` (by vertex, m) to the distance from the nearest of `sources`, where this is less than `limit`.
  /// Calls reached(vertex) for each vertex whose distance fell. Only vertices with may_pass(vertex) are on a path.
  void spread(std::span<const std::int32_t> sources, double limit, std::span<double> distance,
              const std::function<bool(std::int32_t)>& may_pass,
              const std::function<void(std::int32_t)>& reached) const;

 private:
  struct Edge {
    std::int32_t to;
    double length;
  };
  std::vector<std::size_t> first_edge_;  // by vertex, and the total at the end
  std::vector<Edge> edges_;
};

}  // namespace softhand
