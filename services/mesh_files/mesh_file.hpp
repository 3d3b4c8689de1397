// Reads a triangle mesh from an OBJ, STL or glTF file.
#pragma once

#include <string>

#include "model/triangle_mesh.hpp"

namespace softhand {

/// Reads the file by its suffix:
/// - .obj: `v` and `f` lines. Polygons become fans. Negative indices count from the end. Other lines are ignored.
/// - .stl: ASCII or binary.
/// - .glb, .gltf: all triangles of the default scene, with the transformations of the nodes. Buffers can be in the
///   file, in files beside it, or base64.
///
/// Vertices in the same cell of a grid of a micrometre are welded. Triangles with fewer than three corners after that
/// are dropped. `scale` is the length of the file's unit in m. Throws std::runtime_error with file, line or field, and
/// what was expected.
TriangleMesh load_mesh(const std::string& path, double scale = 1);

}  // namespace softhand
