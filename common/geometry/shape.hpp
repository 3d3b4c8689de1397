// Geometry of the objects' solids: signed distance, closest surface point, swept crossing, resting points and mass. All
// values are in the shape's own frame (messages.hpp, `Shape`), in metres.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "math/types.hpp"
#include "messages/messages.hpp"
#include "model/triangle_mesh.hpp"

namespace softhand {

/// The surface point nearest to a query point p.
struct SurfacePoint {
  /// Of p, negative inside. Exact for convex shapes. distance_grid.hpp gives the error of a grid. Inside a compound it
  /// is the distance to the surface of one part, so its amount can be too small.
  double distance = 0;
  Vector3 point = Vector3::Zero();  ///< on the surface
  /// Outward unit normal: the gradient of the distance. If the gradient has several limits (edges, axes, centres), one
  /// of them.
  Vector3 normal = Vector3::UnitY();
};

/// The point at which a straight path enters the solid.
struct Crossing {
  Vector3 point = Vector3::Zero();
  Vector3 normal = Vector3::UnitY();  ///< outward, unit
  double fraction = 0;                ///< 0 at the path's start, 1 at its end
};

/// A ball on which the solid can rest on a half-space. A corner has radius 0.
struct RestingPoint {
  Vector3 centre = Vector3::Zero();
  double radius = 0;
};

/// Properties of the solid filled with unit density.
struct SolidProperties {
  double volume = 0;                   ///< m^3; infinite for a plane
  Vector3 centroid = Vector3::Zero();  ///< m
  Matrix3 inertia = Matrix3::Zero();   ///< m^5, about the centroid; zero for a plane
};

class ShapeGeometry;
class ShapeQueries;  // shape_queries.hpp

/// A part of a compound.
struct PosedShape {
  std::shared_ptr<const ShapeGeometry> shape;
  Pose pose;  ///< of the part in the compound's frame
};

class ShapeGeometry {
 public:
  /// Throws std::invalid_argument with the name of the bad field. Sizes must be finite and > 0 (the half length of a
  /// capsule may be 0). The kind must be known. A hull needs at least four vertices and a volume.
  explicit ShapeGeometry(const Shape& shape);
  /// The inside of a closed, outward mesh as a distance grid (distance_grid.hpp), for example of a link of an object
  /// file. Takes some tenths of a second. `spacing` is the edge of a cell in m: walls must be at least two cells thick.
  /// Throws std::invalid_argument if the mesh is empty or has no volume, or if the spacing is not finite or not > 0. A
  /// grid of more than DistanceGrid::most_samples samples is also refused.
  ShapeGeometry(const TriangleMesh& mesh, double spacing);
  /// The union of posed parts. Throws std::invalid_argument if there are no parts, a part is a plane or null, or the
  /// parts have more than `most_resting_points` resting points together. The mass properties count overlaps twice.
  explicit ShapeGeometry(std::vector<PosedShape> parts);
  ~ShapeGeometry();
  ShapeGeometry(ShapeGeometry&&) noexcept;
  ShapeGeometry& operator=(ShapeGeometry&&) noexcept;

  SurfacePoint closest(const Vector3& point) const;
  double signed_distance(const Vector3& point) const { return closest(point).distance; }
  /// The point at which the segment enters the solid. Returns nothing if the segment misses or starts inside. The
  /// result is exact for convex shapes, and conservative for grids: even thin objects are not missed.
  std::optional<Crossing> first_crossing(const Vector3& from, const Vector3& to) const;
  /// Largest distance of a point of the solid from the frame's origin. Infinite for a plane.
  double bounding_radius() const { return bounding_radius_; }
  /// Writes the points on which the solid can rest on a half-space to `out` and returns their number. `up` is the
  /// outward normal of the half-space (unit, shape's frame). There are at most `most_resting_points`. Their number and
  /// order are constant for a shape:
  /// Box: 8 corners. Sphere: 1 ball. Capsule: 2 balls. Convex hull: its vertices. Plane: none.
  /// Cylinder: 8 per rim, rotated so that one of them is exactly the lowest point of the rim. While the cylinder lies,
  /// this point is replaced by a ball, so rolling is smooth.
  /// Grid: at most 64 corners of the mesh's convex hull. Compound: the points of all parts.
  std::size_t resting_points(const Vector3& up, std::span<RestingPoint> out) const;
  static constexpr std::size_t most_resting_points = kMaxHullVertices;
  /// Corners and small balls on the surface that can pass between two contact points of the skin: the resting points of
  /// at most 1.5 mm radius. A corner counts if a ball of this radius does not fit below it, so a smooth mesh has none.
  std::span<const RestingPoint> sharp_points() const { return sharp_points_; }
  const SolidProperties& solid() const { return properties_; }

 private:
  explicit ShapeGeometry(std::unique_ptr<const ShapeQueries> queries);

  std::unique_ptr<const ShapeQueries> queries_;
  double bounding_radius_ = 0;
  std::vector<RestingPoint> sharp_points_;
  SolidProperties properties_;
};

}  // namespace softhand
