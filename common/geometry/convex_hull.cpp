#include "geometry/convex_hull.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

namespace softhand {
namespace {

// Of `hull_corners`: evenly spread directions, and the smallest distance between two corners that matters, m.
constexpr std::size_t kDirections = 256;
constexpr double kSameReach = 1e-6;

struct Face {
  std::array<int, 3> corners{};
  Vector3 normal = Vector3::Zero();
  double offset = 0;
  bool alive = true;
};

// Directed edges of all living faces: (from, to) -> face. On a closed surface every edge has a reverse edge.
using Edges = std::map<std::pair<int, int>, int>;

class Builder {
 public:
  Builder(std::vector<Vector3> points, double size)
      : points_(std::move(points)), tolerance_(1e-11 * size), size_(size) {}

  /// Returns false if a step is ambiguous: try again with moved points.
  bool build(const std::array<int, 4>& simplex) {
    const Vector3 inside =
        0.25 * (points_[at(simplex[0])] + points_[at(simplex[1])] + points_[at(simplex[2])] + points_[at(simplex[3])]);
    for (const auto& [a, b, c] : {std::array{0, 1, 2}, std::array{0, 2, 3}, std::array{0, 3, 1}, std::array{1, 3, 2}}) {
      std::array<int, 3> corners{simplex[at(a)], simplex[at(b)], simplex[at(c)]};
      const Vector3 normal =
          (points_[at(corners[1])] - points_[at(corners[0])]).cross(points_[at(corners[2])] - points_[at(corners[0])]);
      if (normal.dot(inside - points_[at(corners[0])]) > 0) std::swap(corners[1], corners[2]);
      if (!add_face(corners)) return false;
    }
    while (const std::optional<std::pair<int, int>> next = farthest_point()) {
      if (!add_point(next->first, next->second)) return false;
    }
    return is_closed();
  }

  ConvexHull result() const {
    ConvexHull hull;
    std::map<int, int> index;
    std::vector<int> place(faces_.size(), -1);
    int alive = 0;
    for (std::size_t f = 0; f < faces_.size(); ++f) {
      if (!faces_[f].alive) continue;
      place[f] = alive++;
      for (const int corner : faces_[f].corners) index.emplace(corner, 0);
    }
    for (auto& [point, position] : index) {
      position = static_cast<int>(hull.vertices.size());
      hull.vertices.push_back(points_[at(point)]);
    }
    for (const Face& face : faces_) {
      if (!face.alive) continue;
      hull.faces.push_back({index.at(face.corners[0]), index.at(face.corners[1]), index.at(face.corners[2])});
      std::array<int, 3> across{};
      for (std::size_t k = 0; k < 3; ++k)
        across[k] = place[at(edges_.at({face.corners[(k + 1) % 3], face.corners[k]}))];
      hull.neighbours.push_back(across);
      hull.normals.push_back(face.normal);
      hull.offsets.push_back(face.offset);
    }
    return hull;
  }

 private:
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }
  double height(const Face& face, int point) const { return face.normal.dot(points_[at(point)]) - face.offset; }

  bool add_face(const std::array<int, 3>& corners) {
    Face face;
    face.corners = corners;
    const Vector3 normal =
        (points_[at(corners[1])] - points_[at(corners[0])]).cross(points_[at(corners[2])] - points_[at(corners[0])]);
    if (normal.norm() < 1e-13 * size_ * size_) return false;  // a sliver has no reliable normal
    face.normal = normal.normalized();
    face.offset = face.normal.dot(points_[at(corners[0])] + points_[at(corners[1])] + points_[at(corners[2])]) / 3.0;
    const int index = static_cast<int>(faces_.size());
    for (std::size_t k = 0; k < 3; ++k) {
      if (!edges_.emplace(std::pair(corners[k], corners[(k + 1) % 3]), index).second) return false;
    }
    faces_.push_back(face);
    return true;
  }

  // Returns the pair (point, face) with the largest height of a point above a face.
  std::optional<std::pair<int, int>> farthest_point() const {
    std::optional<std::pair<int, int>> farthest;
    double most = tolerance_;
    for (int f = 0; f < static_cast<int>(faces_.size()); ++f) {
      if (!faces_[at(f)].alive) continue;
      for (int p = 0; p < static_cast<int>(points_.size()); ++p) {
        const double h = height(faces_[at(f)], p);
        if (h > most) {
          most = h;
          farthest = {p, f};
        }
      }
    }
    return farthest;
  }

  bool add_point(int point, int seen_face) {
    std::vector<int> visible{seen_face};
    std::vector<bool> is_visible(faces_.size(), false);
    is_visible[at(seen_face)] = true;
    std::vector<std::pair<int, int>> horizon;
    for (std::size_t next = 0; next < visible.size(); ++next) {
      const std::array<int, 3> corners = faces_[at(visible[next])].corners;
      for (std::size_t k = 0; k < 3; ++k) {
        const auto neighbour = edges_.find({corners[(k + 1) % 3], corners[k]});
        if (neighbour == edges_.end()) return false;
        const int face = neighbour->second;
        if (is_visible[at(face)]) continue;
        if (height(faces_[at(face)], point) > tolerance_) {
          is_visible[at(face)] = true;
          visible.push_back(face);
        }
      }
    }
    for (const int face : visible) {
      const std::array<int, 3>& corners = faces_[at(face)].corners;
      for (std::size_t k = 0; k < 3; ++k) {
        const int across = edges_.at({corners[(k + 1) % 3], corners[k]});
        if (!is_visible[at(across)]) horizon.emplace_back(corners[k], corners[(k + 1) % 3]);
      }
    }
    for (const int face : visible) {
      faces_[at(face)].alive = false;
      const std::array<int, 3>& corners = faces_[at(face)].corners;
      for (std::size_t k = 0; k < 3; ++k) edges_.erase({corners[k], corners[(k + 1) % 3]});
    }
    for (const auto& [from, to] : horizon) {
      if (!add_face({from, to, point})) return false;
    }
    return true;
  }

  bool is_closed() const {
    for (const auto& [edge, face] : edges_) {
      if (!edges_.contains({edge.second, edge.first})) return false;
    }
    for (const Face& face : faces_) {
      if (!face.alive) continue;
      for (int p = 0; p < static_cast<int>(points_.size()); ++p) {
        if (height(face, p) > 1e3 * tolerance_) return false;
      }
    }
    return true;
  }

  std::vector<Vector3> points_;
  double tolerance_;
  double size_;
  std::vector<Face> faces_;
  Edges edges_;
};

// Returns four points that span the set well: two far apart, then the point farthest from their line, then the point
// farthest from their plane.
std::array<int, 4> spanning_simplex(std::span<const Vector3> points, double size) {
  const auto best = [&points](auto measure) {
    int result = 0;
    double most = -1;
    for (int p = 0; p < static_cast<int>(points.size()); ++p) {
      const double value = measure(points[static_cast<std::size_t>(p)]);
      if (value > most) {
        most = value;
        result = p;
      }
    }
    return std::pair(result, most);
  };
  const auto point = [&points](int i) { return points[static_cast<std::size_t>(i)]; };
  const int a = best([&](const Vector3& p) { return (p - points[0]).norm(); }).first;
  const int b = best([&](const Vector3& p) { return (p - point(a)).norm(); }).first;
  const Vector3 line = (point(b) - point(a)).normalized();
  const auto [c, width] = best([&](const Vector3& p) { return (p - point(a)).cross(line).norm(); });
  const Vector3 normal = line.cross(point(c) - point(a)).normalized();
  const auto [d, depth] = best([&](const Vector3& p) { return std::abs((p - point(a)).dot(normal)); });
  if (!(width > 1e-4 * size) || !(depth > 1e-4 * size)) {
    throw std::invalid_argument(
        "convex hull: the vertices lie in a plane, a line or a point; expected a solid thicker than 1e-4 of its size");
  }
  return {a, b, c, d};
}

}  // namespace

ConvexHull convex_hull(std::span<const Vector3> points) {
  if (points.size() < 4)
    throw std::invalid_argument("convex hull: " + std::to_string(points.size()) + " vertices, expected at least 4");
  Eigen::AlignedBox3d bounds;
  for (const Vector3& p : points) {
    if (!p.allFinite()) throw std::invalid_argument("convex hull: a vertex is not finite");
    bounds.extend(p);
  }
  const double size = bounds.diagonal().norm();
  if (!(size > 0)) throw std::invalid_argument("convex hull: all vertices are the same point");
  const std::array<int, 4> simplex = spanning_simplex(points, size);
  for (const double move : {0.0, 1e-9, 1e-8, 1e-7, 1e-6, 1e-5}) {
    std::uint64_t seed = 0x9e3779b97f4a7c15u;
    std::vector<Vector3> moved(points.begin(), points.end());
    for (Vector3& p : moved) {
      for (int axis = 0; axis < 3; ++axis) {
        seed ^= seed << 13;
        seed ^= seed >> 7;
        seed ^= seed << 17;
        p[axis] += move * size * (2.0 * static_cast<double>(seed >> 11) * 0x1p-53 - 1.0);
      }
    }
    Builder builder(std::move(moved), size);
    if (builder.build(simplex)) return builder.result();
  }
  throw std::invalid_argument("convex hull: no closed hull found; remove vertices that are almost equal");
}

std::vector<Vector3> hull_corners(std::span<const Vector3> vertices, std::size_t most) {
  std::vector<Vector3> directions, extremes;
  for (int axis = 0; axis < 3; ++axis)
    for (const double sign : {-1.0, 1.0}) directions.push_back(sign * Vector3::Unit(axis));
  const double golden = M_PI * (3 - std::sqrt(5.0));
  for (std::size_t i = 0; i < kDirections; ++i) {
    const double y = 1 - 2 * (static_cast<double>(i) + 0.5) / kDirections, across = std::sqrt(1 - y * y);
    const double angle = golden * static_cast<double>(i);
    directions.emplace_back(across * std::cos(angle), y, across * std::sin(angle));
  }
  for (const Vector3& direction : directions) {
    extremes.push_back(*std::max_element(vertices.begin(), vertices.end(), [&](const Vector3& a, const Vector3& b) {
      return direction.dot(a) < direction.dot(b);
    }));
  }
  std::vector<double> reach(directions.size(), -1e300);
  std::vector<Vector3> corners;
  const auto choose = [&](std::size_t i) {
    corners.push_back(extremes[i]);
    for (std::size_t k = 0; k < directions.size(); ++k) reach[k] = std::max(reach[k], directions[k].dot(extremes[i]));
  };
  while (corners.size() < most) {
    std::size_t worst = 0;
    double farthest = kSameReach;
    for (std::size_t k = 0; k < directions.size(); ++k) {
      const double beyond = directions[k].dot(extremes[k]) - reach[k];
      if (beyond > farthest) {
        farthest = beyond;
        worst = k;
      }
    }
    if (farthest == kSameReach) break;
    choose(worst);
  }
  return corners;
}

}  // namespace softhand
