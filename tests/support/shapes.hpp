// Shapes of objects for tests.
#pragma once

#include "messages/messages.hpp"

namespace softhand::testing {

/// A cube of half edges `half`, m.
inline Shape cube_shape(double half) {
  Shape shape;
  shape.kind = static_cast<std::uint32_t>(ShapeKind::box);
  shape.size = {half, half, half};
  return shape;
}

}  // namespace softhand::testing
