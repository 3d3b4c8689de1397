// The skin as an implicit surface.
#pragma once

#include <array>

#include "math/types.hpp"

namespace softhand::builder {

/// A closed surface as the zero set of a function that is negative inside. |gradient| is about 1 at most (1.3 is
/// tested).
class SkinShape {
 public:
  virtual ~SkinShape() = default;
  /// Metres, negative inside. Near the surface this is the distance to it.
  virtual double distance(const Vector3& point) const = 0;
  /// A box that contains the surface: low and high corner.
  virtual std::array<Vector3, 2> bounds() const = 0;

  /// Unit outward normal of the level set through `point`.
  Vector3 normal(const Vector3& point) const;
  /// The point moved along the gradient onto the level set `distance == level`.
  Vector3 project(Vector3 point, double level = 0) const;
};

}  // namespace softhand::builder
