#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "geometry/distance_grid.hpp"
#include "geometry/mesh_distance.hpp"
#include "geometry/shape_queries.hpp"

namespace softhand {
namespace {

constexpr std::size_t kDirections = 256;
constexpr std::size_t kMostCorners = 64;

// Corners of the mesh's convex hull: first the farthest vertex along each of six axes, then repeatedly the vertex that
// is farthest beyond the chosen ones in one of evenly spread directions. They enclose the hull except for the rest of
// that distance.
std::vector<Vector3> hull_corners(const std::vector<Vector3>& vertices) {
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
  while (corners.size() < kMostCorners) {
    std::size_t worst = 0;
    double most = 1e-6;  // m
    for (std::size_t k = 0; k < directions.size(); ++k) {
      const double beyond = directions[k].dot(extremes[k]) - reach[k];
      if (beyond > most) {
        most = beyond;
        worst = k;
      }
    }
    if (most == 1e-6) break;
    choose(worst);
  }
  return corners;
}

class GridShape final : public ShapeQueries {
 public:
  GridShape(const TriangleMesh& mesh, double spacing)
      : grid_(mesh, spacing), corners_(hull_corners(mesh.vertices)), properties_(solid_properties(mesh)) {
    if (!(properties_.volume > 0 && std::isfinite(properties_.volume)))
      throw std::invalid_argument(
          "shape: the mesh of the distance grid has no volume, expected a closed, outward mesh");
    for (const Vector3& v : mesh.vertices) radius_ = std::max(radius_, v.norm());
  }
  SurfacePoint closest(const Vector3& p) const override { return grid_.closest(p); }
  std::optional<Crossing> first_crossing(const Vector3& from, const Vector3& to) const override {
    return grid_.first_crossing(from, to);
  }
  double bounding_radius() const override { return radius_; }
  std::size_t resting_points(const Vector3&, std::span<RestingPoint> out) const override {
    for (std::size_t i = 0; i < corners_.size(); ++i) out[i] = {corners_[i], 0};
    return corners_.size();
  }
  SolidProperties properties() const override { return properties_; }

 private:
  DistanceGrid grid_;
  std::vector<Vector3> corners_;
  SolidProperties properties_;
  double radius_ = 0;
};

}  // namespace

std::unique_ptr<const ShapeQueries> make_grid(const TriangleMesh& mesh, double spacing) {
  if (mesh.vertices.empty() || mesh.triangles.empty())
    throw std::invalid_argument("shape: the mesh of the distance grid is empty, expected a closed mesh");
  return std::make_unique<GridShape>(mesh, spacing);
}

}  // namespace softhand
