#include "geometry/surface_distance.hpp"

#include <algorithm>
#include <queue>

namespace softhand {

SurfaceDistance::SurfaceDistance(std::span<const Vector3> vertices,
                                 std::span<const std::array<std::int32_t, 3>> triangles) {
  std::vector<std::pair<std::int32_t, std::int32_t>> pairs;
  for (const auto& corners : triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      pairs.emplace_back(corners[k], corners[(k + 1) % 3]);
      pairs.emplace_back(corners[(k + 1) % 3], corners[k]);
    }
  }
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
  first_edge_.assign(vertices.size() + 1, 0);
  for (const auto& [from, to] : pairs) {
    ++first_edge_[static_cast<std::size_t>(from) + 1];
    edges_.push_back({to, (vertices[static_cast<std::size_t>(to)] - vertices[static_cast<std::size_t>(from)]).norm()});
  }
  for (std::size_t v = 1; v < first_edge_.size(); ++v) first_edge_[v] += first_edge_[v - 1];
}

// Dijkstra's algorithm.
void SurfaceDistance::spread(std::span<const std::int32_t> sources, double limit, std::span<double> distance,
                             const std::function<bool(std::int32_t)>& may_pass,
                             const std::function<void(std::int32_t)>& reached) const {
  using Entry = std::pair<double, std::int32_t>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> queue;
  const auto reach = [&](std::int32_t vertex, double away) {
    if (!(away < limit) || !(away < distance[static_cast<std::size_t>(vertex)]) || !may_pass(vertex)) return;
    distance[static_cast<std::size_t>(vertex)] = away;
    reached(vertex);
    queue.emplace(away, vertex);
  };
  for (const std::int32_t source : sources) reach(source, 0);
  while (!queue.empty()) {
    const auto [away, vertex] = queue.top();
    queue.pop();
    if (away > distance[static_cast<std::size_t>(vertex)]) continue;
    const auto v = static_cast<std::size_t>(vertex);
    for (std::size_t e = first_edge_[v]; e < first_edge_[v + 1]; ++e) reach(edges_[e].to, away + edges_[e].length);
  }
}

}  // namespace softhand
