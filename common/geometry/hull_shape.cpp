#include <array>
#include <cstdint>

#include "geometry/convex_hull.hpp"
#include "geometry/convex_shape.hpp"
#include "geometry/mesh_distance.hpp"

namespace softhand {
namespace {

// Factor on a squared distance. Distances whose squares differ by less than this relative amount count as equal,
// because of rounding.
constexpr double kNearer = 1 - 1e-14;

// The point of a triangle nearest to p, and its place on the triangle.
struct FacePoint {
  Vector3 point = Vector3::Zero();
  int edge = -1;    // edge from corner `edge` to the next corner; -1: inside the triangle
  int corner = -1;  // corner of that edge; -1: inside the edge
};

FacePoint closest_on_triangle(const Vector3& p, const std::array<Vector3, 3>& corners, const Vector3& normal) {
  FacePoint best;
  double least = kInfinity;
  for (int k = 0; k < 3; ++k) {
    const Vector3& from = corners[static_cast<std::size_t>(k)];
    const Vector3 edge = corners[static_cast<std::size_t>((k + 1) % 3)] - from;
    if (normal.cross(edge).dot(p - from) >= 0) continue;
    const double along = edge.dot(p - from) / edge.squaredNorm();
    const Vector3 point = from + std::clamp(along, 0.0, 1.0) * edge;
    const double distance = (p - point).squaredNorm();
    if (distance < least) {
      least = distance;
      best = {point, k, along <= 0 ? k : along >= 1 ? (k + 1) % 3 : -1};
    }
  }
  if (best.edge < 0) best.point = p - normal.dot(p - corners[0]) * normal;
  return best;
}

class Hull final : public ConvexShape {
 public:
  explicit Hull(std::span<const Vector3> points) : hull_(convex_hull(points)) {
    for (const Vector3& v : hull_.vertices) centre_ += v / static_cast<double>(hull_.vertices.size());
    for (std::size_t cell = 0; cell < faces_towards_.size(); ++cell) {
      // The face where the ray leaves the hull.
      const Vector3 direction = direction_of(cell);
      double least = kInfinity;
      for (std::size_t f = 0; f < hull_.faces.size(); ++f) {
        const double way = (hull_.offsets[f] - hull_.normals[f].dot(centre_)) / hull_.normals[f].dot(direction);
        if (way > 0 && way < least) {
          least = way;
          faces_towards_[cell] = static_cast<std::uint16_t>(f);
        }
      }
    }
  }
  SurfacePoint closest(const Vector3& p) const override {
    std::size_t face = faces_towards_[cell_of(p - centre_)];
    if (!(height(p, face) > kOnSurface)) {
      double highest = -kInfinity;
      for (std::size_t f = 0; f < hull_.faces.size(); ++f) {
        const double h = height(p, f);
        if (h > highest) {
          highest = h;
          face = f;
        }
      }
      // Inside, the foot point on the nearest plane lies in that plane's face.
      if (highest <= kOnSurface) return {highest, p - highest * hull_.normals[face], hull_.normals[face]};
    }
    return walk(p, face);
  }
  bool clip(const Vector3& from, const Vector3& direction, double& enter, double& exit,
            Vector3& normal) const override {
    Interval interval;
    for (std::size_t f = 0; f < hull_.faces.size(); ++f)
      interval.cut(hull_.normals[f], hull_.offsets[f], from, direction);
    enter = interval.enter;
    exit = interval.exit;
    normal = interval.normal;
    return !interval.empty();
  }
  double bounding_radius() const override {
    double radius = 0;
    for (const Vector3& v : hull_.vertices) radius = std::max(radius, v.norm());
    return radius;
  }
  std::size_t resting_points(const Vector3&, std::span<RestingPoint> out) const override {
    for (std::size_t i = 0; i < hull_.vertices.size(); ++i) out[i] = {hull_.vertices[i], 0};
    return hull_.vertices.size();
  }
  SolidProperties properties() const override {
    TriangleMesh mesh{hull_.vertices, {}};
    for (const auto& face : hull_.faces) mesh.triangles.push_back({face[0], face[1], face[2]});
    return solid_properties(mesh);
  }

 private:
  static constexpr std::size_t kCells = 8;  // per direction on each side of a cube

  const Vector3& vertex(int i) const { return hull_.vertices[static_cast<std::size_t>(i)]; }
  FacePoint on_face(const Vector3& p, std::size_t f) const {
    const auto& face = hull_.faces[f];
    return closest_on_triangle(p, {vertex(face[0]), vertex(face[1]), vertex(face[2])}, hull_.normals[f]);
  }

  double height(const Vector3& p, std::size_t f) const { return hull_.normals[f].dot(p) - hull_.offsets[f]; }

  // Local search over the surface, from a face that p is above. It walks to a neighbouring face that p is above as long
  // as this face is nearer. A local minimum is the global minimum. Proof: assume that the solid has a nearer point.
  // Then the projection of p - point onto the solid's cone at `point` leads to nearer points. This projection lies in a
  // face around `point` that p is above. (After Lin and Canny 1991.)
  SurfacePoint walk(const Vector3& p, std::size_t f) const {
    FacePoint here = on_face(p, f);
    double least = (p - here.point).squaredNorm();
    const auto nearer = [&](std::size_t other) {
      if (!(height(p, other) > 0)) return false;
      const FacePoint there = on_face(p, other);
      const double distance = (p - there.point).squaredNorm();
      if (!(distance < kNearer * least)) return false;
      f = other;
      here = there;
      least = distance;
      return true;
    };
    const auto step = [&] {
      if (here.edge < 0) return false;
      if (here.corner < 0) return nearer(across(f, here.edge));
      const int corner = hull_.faces[f][static_cast<std::size_t>(here.corner)];
      const std::size_t first = f;
      for (std::size_t other = next_around(first, corner); other != first; other = next_around(other, corner)) {
        if (nearer(other)) return true;
      }
      return false;
    };
    while (step()) {
    }
    const double distance = std::sqrt(least);
    return {distance, here.point, (p - here.point) / distance};
  }
  std::size_t across(std::size_t face, int edge) const {
    return static_cast<std::size_t>(hull_.neighbours[face][static_cast<std::size_t>(edge)]);
  }
  std::size_t next_around(std::size_t face, int corner) const {
    const auto& corners = hull_.faces[face];
    return across(face, corners[0] == corner ? 0 : corners[1] == corner ? 1 : 2);
  }

  // Cells of directions on a cube: first the side (axis and sign), then two coordinates on it.
  static std::size_t cell_of(const Vector3& v) {
    Eigen::Index axis = 0;
    const double longest = v.cwiseAbs().maxCoeff(&axis);
    if (!(longest > 0)) return 0;
    const auto on_side = [&](Eigen::Index other) {
      const double at = 0.5 * (1 + v[other % 3] / longest) * static_cast<double>(kCells);
      return std::min(kCells - 1, static_cast<std::size_t>(at));
    };
    const std::size_t side = 2 * static_cast<std::size_t>(axis) + (v[axis] < 0 ? 1 : 0);
    return (side * kCells + on_side(axis + 1)) * kCells + on_side(axis + 2);
  }
  static Vector3 direction_of(std::size_t cell) {
    const auto at = [](std::size_t i) { return (2.0 * static_cast<double>(i) + 1) / static_cast<double>(kCells) - 1; };
    const std::size_t side = cell / (kCells * kCells);
    const auto axis = static_cast<Eigen::Index>(side / 2);
    Vector3 direction;
    direction[axis] = side % 2 == 0 ? 1 : -1;
    direction[(axis + 1) % 3] = at(cell / kCells % kCells);
    direction[(axis + 2) % 3] = at(cell % kCells);
    return direction;
  }

  ConvexHull hull_;
  Vector3 centre_ = Vector3::Zero();
  /// Start face of a walk, per cell of directions from `centre_`.
  std::array<std::uint16_t, 6 * kCells * kCells> faces_towards_{};
};

}  // namespace

std::unique_ptr<const ShapeQueries> make_hull(std::span<const Vector3> points) {
  return std::make_unique<Hull>(points);
}

}  // namespace softhand
