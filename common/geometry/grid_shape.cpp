#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "geometry/convex_hull.hpp"
#include "geometry/distance_grid.hpp"
#include "geometry/mesh_distance.hpp"
#include "geometry/shape_queries.hpp"

namespace softhand {
namespace {

constexpr std::size_t kMostCorners = 64;

class GridShape final : public ShapeQueries {
 public:
  GridShape(const TriangleMesh& mesh, double spacing)
      : grid_(mesh, spacing), corners_(hull_corners(mesh.vertices, kMostCorners)), properties_(solid_properties(mesh)) {
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
