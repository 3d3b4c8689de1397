// Tetrahedra and display triangles of an implicit surface.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "hand_builder/skin_shape.hpp"

namespace softhand::builder {

struct TetrahedralMesh {
  std::vector<Vector3> nodes;
  std::vector<std::array<std::int32_t, 4>> tetrahedra;  ///< positively oriented
  std::vector<std::array<std::int32_t, 3>> surface;     ///< outward

  double volume() const;                    ///< cubic metres
  double minimum_dihedral_degrees() const;  ///< over all tetrahedra
};

struct TriangleMesh {
  std::vector<Vector3> vertices;
  std::vector<std::array<std::int32_t, 3>> triangles;  ///< outward
};

/// Edge length asked for, as a multiple of a common scale, at a point.
using SizingField = std::function<double(const Vector3&)>;

/// A tetrahedral mesh of `skin` whose edges follow `sizing`, its common scale searched so that it has at least
/// `node_count` nodes, mostly 2 % more and never above 7 %. `seeds` are points of the surface that become nodes
/// (fingertips, so that no coarse mesh cuts them off). CGAL Mesh_3 with its optimisers, none limited by time: the same
/// bits on each run. One component, closed manifold boundary; then `improve`. Throws std::runtime_error where no such
/// mesh is found.
TetrahedralMesh mesh_skin(const SkinShape& skin, const SizingField& sizing, int node_count,
                          const std::vector<Vector3>& seeds);

/// Moves one node at a time where that raises the worst dihedral angle around it. Surface nodes lie outside the skin by
/// so much times `sizing` that the mesh's volume equals `volume` (chords of a convex surface lose some); those of
/// `seeds` lie there, where tetrahedra of sound shape allow it. Never turns a tetrahedron over.
void improve(TetrahedralMesh& mesh, const SkinShape& skin, const SizingField& sizing, const std::vector<Vector3>& seeds,
             double volume);

/// Boundary triangles of positively oriented tetrahedra, outward, in a fixed order.
std::vector<std::array<std::int32_t, 3>> boundary(const std::vector<std::array<std::int32_t, 4>>& tetrahedra);

/// The surface in finer triangles (surface nets on a grid of `cell` metres, vertices then moved onto the surface).
TriangleMesh triangulate_skin(const SkinShape& skin, double cell);

/// Volume inside the surface, summed over a grid of `cell` metres. Cubic metres.
double skin_volume(const SkinShape& skin, double cell);

}  // namespace softhand::builder
