// A mesh of the requested size: CGAL's refinement inside a search for the scale, removal of wrong bridges, then our own
// smoother.
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <stdexcept>

#include "hand_builder/cgal_mesh.hpp"
#include "math/index.hpp"
#include "math/tetrahedron.hpp"
#include "model/tissue_model.hpp"

namespace softhand::builder {
namespace {

class DisjointSets {
 public:
  explicit DisjointSets(std::size_t count) : root_(count) { std::iota(root_.begin(), root_.end(), std::size_t{0}); }
  std::size_t find(std::size_t i) const {
    while (root_[i] != i) i = root_[i];
    return i;
  }
  void join(std::size_t a, std::size_t b) { root_[std::max(find(a), find(b))] = std::min(find(a), find(b)); }

 private:
  std::vector<std::size_t> root_;
};

int shared_nodes(const std::array<std::int32_t, 4>& a, const std::array<std::int32_t, 4>& b) {
  return static_cast<int>(
      std::count_if(a.begin(), a.end(), [&b](std::int32_t n) { return std::find(b.begin(), b.end(), n) != b.end(); }));
}

// Collects tetrahedra around an edge or a node: those outside the largest group that is connected by faces.
void collect_minor_groups(const TetrahedralMesh& mesh, const std::vector<std::int32_t>& around,
                          std::set<std::int32_t>& out) {
  DisjointSets groups(around.size());
  for (std::size_t i = 0; i < around.size(); ++i) {
    for (std::size_t j = i + 1; j < around.size(); ++j) {
      if (shared_nodes(mesh.tetrahedra[at(around[i])], mesh.tetrahedra[at(around[j])]) == 3) groups.join(i, j);
    }
  }
  std::map<std::size_t, double> volumes;
  for (std::size_t i = 0; i < around.size(); ++i) {
    volumes[groups.find(i)] += tetrahedron_volume(mesh.nodes, mesh.tetrahedra[at(around[i])]);
  }
  const auto largest = std::max_element(volumes.begin(), volumes.end(),
                                        [](const auto& a, const auto& b) { return a.second < b.second; });
  for (std::size_t i = 0; i < around.size(); ++i) {
    if (groups.find(i) != largest->first) out.insert(around[i]);
  }
}

// A coarse mesh may touch itself across a web in an edge or a node. The tetrahedra that touch there are bridges. Remove
// the smaller side until the boundary is a closed manifold. Then drop loose parts and number the remaining nodes.
void open_bridges(TetrahedralMesh& mesh) {
  for (bool changed = true; changed;) {
    std::map<std::pair<std::int32_t, std::int32_t>, std::vector<std::int32_t>> edges;
    std::vector<std::vector<std::int32_t>> nodes(mesh.nodes.size());
    DisjointSets components(mesh.tetrahedra.size());
    std::map<std::array<std::int32_t, 3>, std::size_t> faces;
    for (std::size_t t = 0; t < mesh.tetrahedra.size(); ++t) {
      auto sorted = mesh.tetrahedra[t];
      std::sort(sorted.begin(), sorted.end());
      for (std::size_t a = 0; a < 4; ++a) {
        nodes[at(sorted[a])].push_back(static_cast<std::int32_t>(t));
        for (std::size_t b = a + 1; b < 4; ++b) edges[{sorted[a], sorted[b]}].push_back(static_cast<std::int32_t>(t));
        std::array<std::int32_t, 3> face{};
        for (std::size_t k = 0, n = 0; k < 4; ++k) {
          if (k != a) face[n++] = sorted[k];
        }
        const auto [found, fresh] = faces.try_emplace(face, t);
        if (!fresh) components.join(found->second, t);
      }
    }
    std::set<std::int32_t> removed;
    for (const auto& [edge, around] : edges) collect_minor_groups(mesh, around, removed);
    for (const auto& around : nodes) {
      if (!around.empty()) collect_minor_groups(mesh, around, removed);
    }
    std::map<std::size_t, int> sizes;
    for (std::size_t t = 0; t < mesh.tetrahedra.size(); ++t) ++sizes[components.find(t)];
    const auto largest =
        std::max_element(sizes.begin(), sizes.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
    for (std::size_t t = 0; t < mesh.tetrahedra.size(); ++t) {
      if (components.find(t) != largest->first) removed.insert(static_cast<std::int32_t>(t));
    }
    changed = !removed.empty();
    std::vector<std::array<std::int32_t, 4>> retained;
    for (std::size_t t = 0; t < mesh.tetrahedra.size(); ++t) {
      if (!removed.contains(static_cast<std::int32_t>(t))) retained.push_back(mesh.tetrahedra[t]);
    }
    mesh.tetrahedra = std::move(retained);
  }
  std::vector<std::int32_t> number(mesh.nodes.size(), -1);
  std::vector<Vector3> retained;
  for (auto& t : mesh.tetrahedra) {
    for (std::int32_t& n : t) {
      if (number[at(n)] < 0) {
        number[at(n)] = static_cast<std::int32_t>(retained.size());
        retained.push_back(mesh.nodes[at(n)]);
      }
      n = number[at(n)];
    }
  }
  mesh.nodes = std::move(retained);
  mesh.surface = boundary(mesh.tetrahedra);
}

// The Euler characteristic of a closed surface without handles is 2. It has 3/2 as many edges as triangles.
bool is_topological_ball(const TetrahedralMesh& mesh) {
  std::set<std::int32_t> outer;
  for (const auto& t : mesh.surface) outer.insert(t.begin(), t.end());
  return 2 * outer.size() == 4 + mesh.surface.size();
}

}  // namespace

TetrahedralMesh mesh_skin(const SkinShape& skin, const SizingField& sizing, int node_count,
                          const std::vector<Vector3>& seeds) {
  // The node count is proportional to a power of the scale between -2 (surface) and -3. Start from a guess, then follow
  // the measured counts.
  double scale = 0.0042 * std::pow(1450.0 / node_count, 0.45);
  // A coarse mesh may have a handle between two fingers. Only meshes without a handle are accepted.
  constexpr double kGoal = 1.02;
  double least_error = std::numeric_limits<double>::infinity();
  TetrahedralMesh best;
  for (int trial = 0; trial < 48 && least_error > 0.02; ++trial) {
    TetrahedralMesh mesh = cgal_mesh(skin, sizing, scale, seeds);
    open_bridges(mesh);
    const double ratio = static_cast<double>(mesh.nodes.size()) / (kGoal * node_count);
    const double error = std::abs(std::log(ratio));
    const bool enough = static_cast<int>(mesh.nodes.size()) >= node_count;
    if (enough && is_topological_ball(mesh) && error < least_error) {
      least_error = error;
      best = std::move(mesh);
    }
    // If the count is right but the topology is wrong, a slightly different scale gives another mesh.
    scale *= error > 0.02 ? std::pow(ratio, 0.42) : trial % 2 == 0 ? 0.99 : 1.015;
  }
  if (!(least_error < 0.05))
    throw std::runtime_error("mesh: no valid mesh of " + std::to_string(node_count) + " nodes or up to 7 % more");
  improve(best, skin, sizing, seeds, skin_volume(skin, 0.001));
  return best;
}

}  // namespace softhand::builder
