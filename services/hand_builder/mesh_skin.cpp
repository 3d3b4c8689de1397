// The mesh of asked size: CGAL's refinement inside a search for the scale, then our own smoother.
#include <cstdio>
#include <cstdlib>
#include <cmath>
#include <map>
#include <stdexcept>

#include "hand_builder/cgal_mesh.hpp"

namespace softhand::builder {
namespace {

// One component, every node used: the largest set of tetrahedra that hang together by faces must be all of them.
bool one_component(const TetrahedralMesh& mesh) {
  std::vector<std::int32_t> root(mesh.nodes.size());
  for (std::size_t n = 0; n < root.size(); ++n) root[n] = static_cast<std::int32_t>(n);
  const auto find = [&root](std::int32_t n) {
    while (root[static_cast<std::size_t>(n)] != n) n = root[static_cast<std::size_t>(n)];
    return n;
  };
  for (const auto& t : mesh.tetrahedra) {
    for (std::size_t k = 1; k < 4; ++k) root[static_cast<std::size_t>(find(t[k]))] = find(t[0]);
  }
  for (std::size_t n = 0; n < root.size(); ++n) {
    if (find(static_cast<std::int32_t>(n)) != find(0)) return false;
  }
  return !mesh.nodes.empty();
}

bool closed_manifold(const TetrahedralMesh& mesh) {
  std::map<std::pair<std::int32_t, std::int32_t>, int> directed;
  for (const auto& f : mesh.surface) {
    for (std::size_t k = 0; k < 3; ++k) ++directed[{f[k], f[(k + 1) % 3]}];
  }
  bool good = true;
  for (const auto& [edge, uses] : directed) {
    const auto back = directed.find({edge.second, edge.first});
    if (uses != 1 || back == directed.end() || back->second != 1) {
      if (getenv("TRACE")) { Vector3 m = 0.5e3 * (mesh.nodes[edge.first] + mesh.nodes[edge.second]); printf("bad edge %d %d uses %d at %g %g %g\n", edge.first, edge.second, uses, m.x(), m.y(), m.z()); }
      good = false;
    }
  }
  return good;
}

}  // namespace

TetrahedralMesh mesh_skin(const SkinShape& skin, const SizingField& sizing, double scale, const std::vector<Vector3>& seeds) {
  TetrahedralMesh mesh = cgal_mesh(skin, sizing, scale, seeds);
  if (!one_component(mesh)) throw std::runtime_error("mesh: more than one component");
  mesh.surface = boundary(mesh.tetrahedra);

  improve(mesh, skin, skin_volume(skin, 0.001));
  return mesh;
}

TetrahedralMesh mesh_skin_with_nodes(const SkinShape& skin, const SizingField& sizing, int node_count, const std::vector<Vector3>& seeds) {
  // Counts go with scale to a power between -2 (surface) and -3; start from a guess, then follow the measured counts. A mesh that is not sound is
  // passed over, its neighbour in scale is tried.
  double scale = 0.0031 * std::pow(1450.0 / node_count, 0.42);
  double best_scale = 0, best_error = 1e9;
  for (int trial = 0; trial < 9; ++trial) {
    const TetrahedralMesh mesh = cgal_mesh(skin, sizing, scale, seeds);
    TetrahedralMesh checked = mesh;
    checked.surface = boundary(checked.tetrahedra);
    const double ratio = static_cast<double>(mesh.nodes.size()) / node_count;
    const double error = std::abs(std::log(ratio));
    if (one_component(checked) && error < best_error) {
      best_error = error;
      best_scale = scale;
    }
    if (getenv("TRACE")) printf("scale %g nodes %zu one %d man %d\n", scale, mesh.nodes.size(), one_component(checked), closed_manifold(checked)), fflush(stdout);
    if (best_error < 0.03) break;
    scale *= error < 0.03 ? 1.01 : std::pow(ratio, 0.42);
  }
  if (best_scale == 0) throw std::runtime_error("mesh: no sound mesh near " + std::to_string(node_count) + " nodes");
  return mesh_skin(skin, sizing, best_scale, seeds);
}

}  // namespace softhand::builder
