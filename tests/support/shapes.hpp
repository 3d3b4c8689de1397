// Shapes of objects for tests.
#pragma once

#include "messages/messages.hpp"

namespace softhand::testing {

/// A box of these half extents, m.
inline Shape box_shape(const Vec3& half) {
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(ShapeKind::box);
  shape.size = half;
  return shape;
}
/// A cube of half edges `half`, m.
inline Shape cube_shape(double half) { return box_shape({half, half, half}); }
inline Shape sphere_shape(double radius) {
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(ShapeKind::sphere);
  shape.size = {radius, 0, 0};
  return shape;
}

}  // namespace softhand::testing
