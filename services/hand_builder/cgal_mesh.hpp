// The only interface to CGAL.
#pragma once

#include "hand_builder/mesher.hpp"

namespace softhand::builder {

/// Delaunay refinement and its optimisers. Returns nodes and positively oriented tetrahedra without a surface.
/// Deterministic.
TetrahedralMesh cgal_mesh(const SkinShape& skin, const SizingField& sizing, double scale,
                          const std::vector<Vector3>& seeds);

}  // namespace softhand::builder
