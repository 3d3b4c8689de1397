// Approximate convex decomposition of a closed mesh, for physics engines that need convex pieces.
#pragma once

#include "geometry/mesh_distance.hpp"

namespace softhand::builder {

struct ConvexPieces {
  std::vector<std::vector<Vector3>> pieces;  ///< corners of each convex piece
  double missing = 0;                        ///< part of the solid's volume that no piece contains
  double excess = 0;                         ///< volume of the pieces outside the solid, over the solid's volume
};

/// Cuts the solid by planes, always the piece whose hull exceeds the solid most, until there are `most_pieces` or the
/// excess is below `tolerance` (a fraction of the volume). Each cut is the one with the smallest hulls among 9
/// directions and 7 places each. Each hull is reduced to `most_vertices` corners. The volumes are measured on a grid of
/// 200,000 points in the bounding box. Deterministic.
ConvexPieces convex_pieces(const TriangleMesh& mesh, std::size_t most_pieces, std::size_t most_vertices,
                           double tolerance);

}  // namespace softhand::builder
