// A hand loop with the block hand, and one cube below its fingers.
#pragma once

#include <gtest/gtest.h>

#include "hand/hand_loop.hpp"
#include "messages/convert.hpp"
#include "support/block_hand.hpp"
#include "support/shapes.hpp"
#include "support/skeleton.hpp"

namespace softhand::testing {

inline constexpr Nanoseconds kSecond = 1'000'000'000;

inline std::size_t index(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }

/// A hand whose tissue is attached well enough to follow its bones.
inline HandModel hand() { return block_hand(1); }

inline HandOptions loop_options() {
  HandOptions o;
  o.simulation.solver.max_iterations = 4;
  o.mirrored_objects = 1;
  o.static_objects = 0;
  // A node of the block hand has 50 times the area of a shipped hand's contact point.
  o.simulation.contact_stiffness = contact_stiffness(hand(), 12000);
  return o;
}

inline ObjectDescription cube(std::uint32_t id) {
  ObjectDescription d;
  d.object = id;
  d.mass = 0.05;
  d.inertia = {1.33e-5, 1.33e-5, 1.33e-5};
  d.friction = 0.8;
  d.shape = cube_shape(0.02);
  return d;
}

inline WorldObjects world_with(std::uint32_t id, const Vector3& position, Nanoseconds time) {
  WorldObjects world;
  world.stamp.sample_time = time;
  ObjectState state;
  state.object = id;
  state.position = to_wire(position);
  world.objects.push_back(state);
  return world;
}

/// Makes a step at kSecond. From then on object 3, which is below the fingers, has a twin.
inline WorldObjects come_near_a_cube(HandLoop& loop) {
  loop.describe_object(cube(3));
  const Skeleton sample = skeleton_at(hand(), {}, kSecond, 1);
  const WorldObjects world = world_with(3, Vector3(-0.012, -0.045, -0.092), kSecond);
  EXPECT_EQ(loop.step(kSecond, {&sample, nullptr, &world}, {}).coupling.twins.size(), 1u);
  return world;
}

}  // namespace softhand::testing
