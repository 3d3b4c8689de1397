#include "object_builder/soft_body.hpp"

#include <stdexcept>

#include "hand_builder/mesher.hpp"
#include "hand_builder/rigged_hand.hpp"
#include "mesh_files/mesh_file.hpp"
#include "object_builder/cgal_solid.hpp"

namespace softhand::builder {

SoftBody build_soft_body(const SoftSource& source, double scale) {
  constexpr std::int64_t kFewest = 30;
  constexpr double kFarthest = 1;                                                          // m
  const auto most = static_cast<std::int64_t>(0.93 * static_cast<double>(kMaxSoftNodes));  // the mesher makes 7 % more
  if (source.nodes < kFewest || source.nodes > most)
    throw std::runtime_error("soft.nodes: expected " + std::to_string(kFewest) + " to " + std::to_string(most));
  const TriangleMesh mesh = load_mesh(source.mesh, scale);
  if (const auto fault = fault_of_solid(mesh)) throw std::runtime_error(source.mesh + ": expected " + *fault);
  // A mesh in millimetres would be meshed with cells of millimetres, which takes all memory.
  for (const Vector3& vertex : mesh.vertices) {
    if (!(vertex.cwiseAbs().maxCoeff() <= kFarthest))
      throw std::runtime_error(source.mesh + ": expected vertices in metres, at most 1 m from the origin; see --scale");
  }
  SoftBody body;
  body.material = {"soft",
                   source.density,
                   source.youngs_modulus,
                   source.poisson_ratio,
                   source.strain_limit_energy,
                   source.strain_limit_stiffness,
                   source.strain_limit_ramp};
  body.friction = source.friction;
  TetrahedralMesh tetrahedra;
  try {
    const MeshSkin skin(mesh);
    tetrahedra = mesh_skin(skin, [](const Vector3&) { return 1.0; }, static_cast<int>(source.nodes), {});
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(source.mesh + ": " + error.what() +
                             "; expected a surface without handles, and enough nodes for its thinnest part");
  }
  for (const Vector3& node : tetrahedra.nodes) body.nodes.push_back(rounded_position(node));
  body.tetrahedra = std::move(tetrahedra.tetrahedra);
  return body;
}

}  // namespace softhand::builder
