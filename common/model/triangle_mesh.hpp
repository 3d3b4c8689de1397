// A triangle mesh. Plain data.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "math/types.hpp"

namespace softhand {

struct TriangleMesh {
  std::vector<Vector3> vertices;                       ///< m
  std::vector<std::array<std::int32_t, 3>> triangles;  ///< vertex indices; outward orientation
};

}  // namespace softhand
