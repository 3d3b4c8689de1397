// The solids that objects are made of, loaded: signed distance, closest surface point, swept crossing, resting points,
// mass. All are convex. Everything is in the shape's own frame (messages.hpp, `Shape`), metres.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "math/types.hpp"
#include "messages/messages.hpp"

namespace softhand {

/// The surface point nearest to a query point p.
struct SurfacePoint {
  double distance = 0;                ///< of p, negative inside. Exact outside and inside for every shape
  Vector3 point = Vector3::Zero();    ///< on the surface
  Vector3 normal = Vector3::UnitY();  ///< outward, unit; grad of the distance, and one of its limits where it has
                                      ///< several (edges, axes, centres)
};

/// Where a straight path enters the solid.
struct Crossing {
  Vector3 point = Vector3::Zero();
  Vector3 normal = Vector3::UnitY();  ///< outward, unit
  double fraction = 0;                ///< 0 at the path's start, 1 at its end
};

/// A ball on which the solid can rest on a half-space; a corner has radius 0.
struct RestingPoint {
  Vector3 centre = Vector3::Zero();
  double radius = 0;
};

/// Of the solid filled with unit density.
struct SolidProperties {
  double volume = 0;                   ///< m^3; infinite for a plane
  Vector3 centroid = Vector3::Zero();  ///< m
  Matrix3 inertia = Matrix3::Zero();   ///< m^5, about the centroid; zero for a plane
};

class Solid;  // shape.cpp

class ShapeGeometry {
 public:
  /// Throws std::invalid_argument naming the field: sizes not finite or not > 0 (a capsule's half length may be 0),
  /// unknown kind, a hull of fewer than four vertices or without volume.
  explicit ShapeGeometry(const Shape& shape);
  ~ShapeGeometry();
  ShapeGeometry(ShapeGeometry&&) noexcept;
  ShapeGeometry& operator=(ShapeGeometry&&) noexcept;

  SurfacePoint closest(const Vector3& point) const;
  double signed_distance(const Vector3& point) const { return closest(point).distance; }
  /// Where the segment enters the solid; nothing when it misses or starts inside. Exact: no sampling, so nothing is
  /// thin enough to be missed.
  std::optional<Crossing> first_crossing(const Vector3& from, const Vector3& to) const;
  /// Greatest distance of a point of the solid from the frame's origin; infinite for a plane.
  double bounding_radius() const { return bounding_radius_; }
  /// The points on which the solid can rest on a half-space with outward normal `up` (unit, shape's frame): at most
  /// `most_resting_points`. Their number and order are constant. Box: 8 corners; sphere 1; capsule 2; hull: its
  /// vertices; cylinder: 8 a rim, turned so that one of them is the lowest exactly, and that one a ball while the
  /// cylinder lies (rolling is smooth); a plane has none. Writes to `out` and returns the count.
  std::size_t resting_points(const Vector3& up, std::span<RestingPoint> out) const;
  static constexpr std::size_t most_resting_points = kMaxHullVertices;
  const SolidProperties& solid() const { return properties_; }

 private:
  std::unique_ptr<const Solid> solid_;
  double bounding_radius_ = 0;
  SolidProperties properties_;
};

}  // namespace softhand
