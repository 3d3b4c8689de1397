// Simulations of the block hand, and the targets of its bones.
#pragma once

#include <algorithm>

#include "scene/hand_simulation.hpp"
#include "support/block_hand.hpp"

namespace softhand::testing {

inline constexpr double kStep = 1.0 / 90;

inline std::size_t index(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }

/// A hand whose tissue is attached well enough to follow its bones.
inline HandModel hand() { return block_hand(1); }

inline SimulationOptions options() {
  SimulationOptions o;
  o.solver.max_iterations = 4;
  return o;
}

inline void set_rest_targets(HandSimulation& simulation, const Pose& wrist) {
  for (int b = 0; b < kBodyCount; ++b) {
    const Body body = static_cast<Body>(b);
    simulation.set_target(body, wrist * simulation.hand().rest_joints[index(joint_of(body))], {});
  }
}

inline double worst_joint_error(const HandSimulation& simulation, const Pose& wrist) {
  double worst = 0;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    worst = std::max(worst, (simulation.joint_pose(static_cast<Joint>(j)).position -
                             wrist * simulation.hand().rest_joints[j].position)
                                .norm());
  }
  return worst;
}

}  // namespace softhand::testing
