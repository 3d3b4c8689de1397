#include "scene/rest_error.hpp"

#include <cmath>

#include "scene/hand_simulation.hpp"

namespace softhand {

namespace {

// Lets the tissue settle while the bones stay in place.
Eigen::Matrix3Xd settled(HandSimulation& simulation, const State& from) {
  constexpr double kLongStep = 0.1;  // s; so long that the inertia of the tissue hardly matters
  constexpr int kSteps = 100;
  constexpr double kStill = 1e-9;  // m, largest motion of a node in a step at rest
  simulation.restore(from);
  for (int i = 0; i < kSteps; ++i) {
    const Eigen::Matrix3Xd before = simulation.state().node_positions;
    simulation.step(kLongStep);
    if ((simulation.state().node_positions - before).colwise().norm().maxCoeff() < kStill) break;
  }
  return simulation.state().node_positions;
}

}  // namespace

double rest_error(const HandModel& hand, const State& state) {
  constexpr double kImmovable = 1e6;  // factor on a bone's mass, so that it does not move while the tissue settles
  if (hand.tetrahedra.empty()) return 0;
  HandModel still = hand;
  for (BodyModel& body : still.bodies) {
    body.mass *= kImmovable;
    body.inertia *= kImmovable;
  }
  SimulationOptions options;
  options.untangle_patience = 0;
  options.solver.residual_tolerance = 1e-7;
  options.solver.movement_tolerance = 1e-8;
  options.solver.chord_tolerance = 0;
  HandSimulation simulation(still, options, 0, 0);
  State from = simulation.state();
  for (std::size_t b = 0; b < kBodyCount; ++b) from.body_poses[b] = state.body_poses[b];
  from.node_positions = state.node_positions.leftCols(hand.node_count());
  const Eigen::Matrix3Xd present = settled(simulation, from);
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    const Pose rest = hand.body_rest_pose(static_cast<Body>(hand.node_body[n]));
    from.node_positions.col(static_cast<Eigen::Index>(n)) =
        from.body_poses[hand.node_body[n]] * (rest.inverse() * hand.nodes[n]);
  }
  return std::sqrt((present - settled(simulation, from)).squaredNorm() / hand.node_count());
}

}  // namespace softhand
