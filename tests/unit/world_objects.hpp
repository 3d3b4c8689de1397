// A table, a cube, and access to their states in a world's output.
#pragma once

#include <array>
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
/// Makes one step of a new world long before the time 0. From then on the world accepts claims of the hands of user 0.
inline void accept_claims(WorldLoop& world) {
  std::array<ObjectCoupling, 2> hands;
  hands[0].hand = {0, 0};
  hands[1].hand = {0, 1};
  world.step(-1'000'000'000, {hands});
}
inline const ObjectState& object(const WorldOutput& out, std::uint32_t id) {
  for (const ObjectState& state : out.objects.objects)
    if (state.object == id) return state;
  throw std::runtime_error("object is not in the snapshot");
}
inline Vector3 position(const ObjectState& state) { return to_vector(state.position); }

}  // namespace softhand::test
