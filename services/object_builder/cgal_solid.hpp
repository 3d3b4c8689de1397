// The only interface to CGAL's polygon mesh processing.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "model/triangle_mesh.hpp"

namespace softhand::builder {

/// The first of these faults that the mesh has, as the end of a sentence "expected ...". Nothing if it has none:
/// not a closed 2-manifold, self-intersections, or triangles that do not bound a volume with outward orientation.
std::optional<std::string> fault_of_solid(const TriangleMesh& mesh);

/// The union of closed, outward meshes (corefinement). Throws std::runtime_error if the union is not a manifold.
TriangleMesh united(const std::vector<TriangleMesh>& meshes);

}  // namespace softhand::builder
