// Interface of all kinds of shape behind ShapeGeometry. Internal to this folder. All values are in the shape's frame.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <span>

#include "geometry/shape.hpp"

namespace softhand {

/// The queries of one kind of shape. ShapeGeometry documents them. No query allocates memory.
class ShapeQueries {
 public:
  virtual ~ShapeQueries() = default;
  virtual SurfacePoint closest(const Vector3& p) const = 0;
  virtual std::optional<Crossing> first_crossing(const Vector3& from, const Vector3& to) const = 0;
  virtual double bounding_radius() const = 0;
  virtual std::size_t resting_points(const Vector3& up, std::span<RestingPoint> out) const = 0;
  virtual SolidProperties properties() const = 0;
};

// The arguments are valid: ShapeGeometry has checked them. Lengths are in metres.
std::unique_ptr<const ShapeQueries> make_sphere(double radius);
std::unique_ptr<const ShapeQueries> make_box(const Vector3& half);
std::unique_ptr<const ShapeQueries> make_capsule(double radius, double half_length);
std::unique_ptr<const ShapeQueries> make_cylinder(double radius, double half_length);
std::unique_ptr<const ShapeQueries> make_plane();
/// Throws std::invalid_argument as `convex_hull` does.
std::unique_ptr<const ShapeQueries> make_hull(std::span<const Vector3> points);
/// The mesh is closed and outward. Throws std::invalid_argument if the grid would be too large.
std::unique_ptr<const ShapeQueries> make_grid(const TriangleMesh& mesh, double spacing);
/// Throws std::invalid_argument if there are no parts, a part is a plane, or the parts have too many resting points.
std::unique_ptr<const ShapeQueries> make_compound(std::vector<PosedShape> parts);

}  // namespace softhand
