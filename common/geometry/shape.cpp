#include "geometry/shape.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <stdexcept>
#include <string>

#include "geometry/shape_queries.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kSharpRadius = 1.5e-3;  // m
// The centre of a ball that touches a smooth surface from inside is a radius below it. Below a corner it is nearer to
// the surface. A corner is sharp if it is nearer than this part of the radius.
constexpr double kSmooth = 0.9;

void check_size(const char* kind, const char* field, double value, bool zero_allowed = false) {
  if (std::isfinite(value) && (value > 0 || (zero_allowed && value == 0))) return;
  throw std::invalid_argument(std::string("shape: ") + field + " of the " + kind + " is " + std::to_string(value) +
                              " m, expected a finite number " + (zero_allowed ? ">= 0" : "> 0"));
}

std::unique_ptr<const ShapeQueries> load(const Shape& shape) {
  const Vec3& size = shape.size;
  switch (static_cast<ShapeKind>(shape.kind)) {
    case ShapeKind::sphere:
      check_size("sphere", "radius", size[0]);
      return make_sphere(size[0]);
    case ShapeKind::box:
      for (const double half : size) check_size("box", "half extent", half);
      return make_box(to_vector(size));
    case ShapeKind::capsule:
      check_size("capsule", "radius", size[0]);
      check_size("capsule", "half length", size[1], true);
      return make_capsule(size[0], size[1]);
    case ShapeKind::cylinder:
      check_size("cylinder", "radius", size[0]);
      check_size("cylinder", "half length", size[1]);
      return make_cylinder(size[0], size[1]);
    case ShapeKind::plane:
      return make_plane();
    case ShapeKind::convex_hull: {
      if (shape.vertices.size() > kMaxHullVertices) {
        throw std::invalid_argument("shape: convex hull of " + std::to_string(shape.vertices.size()) +
                                    " vertices, expected at most " + std::to_string(kMaxHullVertices));
      }
      std::vector<Vector3> points;
      for (const Vec3& v : shape.vertices) points.push_back(to_vector(v));
      return make_hull(points);
    }
    case ShapeKind::file:
      throw std::invalid_argument("shape: a link of an object file, expected its mesh");
  }
  throw std::invalid_argument("shape: kind is " + std::to_string(shape.kind) + ", expected 0 to 6");
}

}  // namespace

ShapeGeometry::ShapeGeometry(std::unique_ptr<const ShapeQueries> queries)
    : queries_(std::move(queries)), bounding_radius_(queries_->bounding_radius()), properties_(queries_->properties()) {
  std::array<RestingPoint, most_resting_points> points;
  const std::size_t count = resting_points(Vector3::UnitY(), points);
  const auto is_sharp = [this](const RestingPoint& point) {
    if (point.radius > 0) return point.radius <= kSharpRadius;
    const Vector3 inside = point.centre - kSharpRadius * closest(point.centre).normal;
    return closest(inside).distance > -kSmooth * kSharpRadius;
  };
  std::copy_if(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(count), std::back_inserter(sharp_points_),
               is_sharp);
}
ShapeGeometry::ShapeGeometry(const Shape& shape) : ShapeGeometry(load(shape)) {}
ShapeGeometry::ShapeGeometry(const TriangleMesh& mesh, double spacing) : ShapeGeometry(make_grid(mesh, spacing)) {}
ShapeGeometry::ShapeGeometry(std::vector<PosedShape> parts) : ShapeGeometry(make_compound(std::move(parts))) {}
ShapeGeometry::~ShapeGeometry() = default;
ShapeGeometry::ShapeGeometry(ShapeGeometry&&) noexcept = default;
ShapeGeometry& ShapeGeometry::operator=(ShapeGeometry&&) noexcept = default;

SurfacePoint ShapeGeometry::closest(const Vector3& point) const { return queries_->closest(point); }

std::optional<Crossing> ShapeGeometry::first_crossing(const Vector3& from, const Vector3& to) const {
  return queries_->first_crossing(from, to);
}

std::size_t ShapeGeometry::resting_points(const Vector3& up, std::span<RestingPoint> out) const {
  return queries_->resting_points(up, out);
}

}  // namespace softhand
