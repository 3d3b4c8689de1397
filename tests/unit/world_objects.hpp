// A table, a cube, and access to their states in a world's output.
#pragma once

#include <stdexcept>

#include "messages/convert.hpp"
#include "world/world_loop.hpp"

namespace softhand::test {

inline ObjectOptions table() {
  ObjectOptions o;
  o.name = "table";
  o.half_extents = {0.5, 0.02, 0.5};
  o.position = {0, -0.02, 0};
  return o;
}
inline ObjectOptions cube(double mass, double height) {
  ObjectOptions o;
  o.name = "cube";
  o.mass = mass;
  o.position = {0, height, 0};
  return o;
}
inline const ObjectState& object(const WorldOutput& out, std::uint32_t id) {
  for (const ObjectState& state : out.objects.objects)
    if (state.object == id) return state;
  throw std::runtime_error("object is not in the snapshot");
}
inline Vector3 position(const ObjectState& state) { return to_vector(state.position); }

}  // namespace softhand::test
