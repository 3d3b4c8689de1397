// Tetrahedra and display triangles of an implicit surface.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "hand_builder/skin_shape.hpp"
#include "model/triangle_mesh.hpp"

namespace softhand::builder {

struct TetrahedralMesh {
  std::vector<Vector3> nodes;
  std::vector<std::array<std::int32_t, 4>> tetrahedra;  ///< positively oriented
  std::vector<std::array<std::int32_t, 3>> surface;     ///< outward orientation

  double volume() const;                    ///< cubic metres
  double minimum_dihedral_degrees() const;  ///< over all tetrahedra
};

/// The requested edge length at a point, as a multiple of a common scale.
using SizingField = std::function<double(const Vector3&)>;

/// Makes a tetrahedral mesh of `skin` whose edges follow `sizing`. The common scale is searched such that the mesh has
/// at least `node_count` nodes, mostly 2 % more and never more than 7 % more. `seeds` are points of the surface that
/// become nodes (fingertips, so that a coarse mesh does not cut them off). Uses CGAL Mesh_3 with its optimisers without
/// time limits, so every run gives the same bits. The mesh has one component and a closed manifold boundary. Then calls
/// `improve`. Throws std::runtime_error if no such mesh is found.
TetrahedralMesh mesh_skin(const SkinShape& skin, const SizingField& sizing, int node_count,
                          const std::vector<Vector3>& seeds);

/// Moves one node at a time if this increases the worst dihedral angle around it. Surface nodes lie outside the skin,
/// at a height proportional to `sizing`. The height is such that the mesh's volume equals `volume`, because chords of a
/// convex surface lose volume. Nodes of `seeds` lie on the skin if the shape of the tetrahedra allows it. Never inverts
/// a tetrahedron.
void improve(TetrahedralMesh& mesh, const SkinShape& skin, const SizingField& sizing, const std::vector<Vector3>& seeds,
             double volume);

/// Removes the flat ears that join two parts of the mesh, one after the other. An ear is a tetrahedron with two faces
/// on the surface. It is flat if they meet at more than 138 degrees. Where two fingers squeeze the web between them,
/// the edge between these faces moves past the opposite edge, and the ear turns inside out. `part` has the part of each
/// node, or -1 if it belongs to none. The boundary remains a closed manifold with the same nodes.
void remove_flat_ears(TetrahedralMesh& mesh, const std::vector<int>& part);

/// The surface in finer triangles: surface nets on a grid of `cell` metres, with vertices then moved onto the surface.
TriangleMesh triangulate_skin(const SkinShape& skin, double cell);

/// Volume inside the surface in cubic metres, summed over a grid of `cell` metres.
double skin_volume(const SkinShape& skin, double cell);

}  // namespace softhand::builder
