// Two hands of one simulation, palm towards palm.
#pragma once

#include <algorithm>

#include "energies/skin_contact.hpp"
#include "scene/hand_simulation.hpp"

namespace softhand::testing {

/// A right hand above and its mirror image below. The palms face each other, and the fingers point to -Z.
class PalmToPalm {
 public:
  /// `gap`: m, between the skins. Negative: they overlap.
  PalmToPalm(const HandModel& right, const SimulationOptions& options, double gap, int mirrored_slots = 0)
      : simulation(std::vector{right, mirrored(right)}, options, mirrored_slots, 0) {
    double lowest = 0;  // of the skin below the wrist, m
    for (const Vector3& node : right.nodes) lowest = std::min(lowest, node.y());
    const double half = 0.5 * gap - lowest;
    wrists_ = {Pose{{0, half, 0}, Quaternion::Identity()},
               Pose{{0, -half, 0}, Quaternion(Eigen::AngleAxisd(M_PI, Vector3::UnitZ()))}};
    for (int hand = 0; hand < 2; ++hand) simulation.reposition(wrist(hand), hand);
  }

  const Pose& wrist(int hand) const { return wrists_[static_cast<std::size_t>(hand)]; }
  /// Pulls both hands to their rest pose, moved towards each other by `closer` m in total.
  void aim(double closer) {
    for (int hand = 0; hand < 2; ++hand) {
      Pose wrist = wrists_[static_cast<std::size_t>(hand)];
      wrist.position.y() += hand == 0 ? -0.5 * closer : 0.5 * closer;
      for (int b = 0; b < kBodyCount; ++b) {
        const Body body = static_cast<Body>(b);
        const auto joint = static_cast<std::size_t>(index_of(joint_of(body)));
        simulation.set_target(body, wrist * simulation.hand(hand).rest_joints[joint], {}, 1, hand);
      }
    }
  }
  /// Gives all of a hand a velocity, m/s.
  void throw_hand(int hand, const Vector3& velocity) {
    State state = simulation.state();
    state.node_velocities.middleCols(simulation.first_node(hand), simulation.hand(hand).node_count()).colwise() =
        velocity;
    for (int b = 0; b < kBodyCount; ++b)
      state.body_velocities[static_cast<std::size_t>(simulation.first_body(hand) + b)].linear = velocity;
    simulation.restore(state);
  }
  /// Of a hand, kg m/s.
  Vector3 momentum(int hand) const {
    const HandModel& model = simulation.hand(hand);
    const State& state = simulation.state();
    const std::vector<double> masses = lumped_masses(model);
    Vector3 sum = Vector3::Zero();
    for (int n = 0; n < model.node_count(); ++n)
      sum += masses[static_cast<std::size_t>(n)] * state.node_velocities.col(simulation.first_node(hand) + n);
    for (std::size_t b = 0; b < kBodyCount; ++b)
      sum += model.bodies[b].mass *
             state.body_velocities[static_cast<std::size_t>(simulation.first_body(hand)) + b].linear;
    return sum;
  }
  /// Of the skin of the other hand on this hand, N.
  Vector3 force_on(int hand) const {
    Vector3 sum = Vector3::Zero();
    const SkinContact& skin = *simulation.skin_between();
    for (const SkinAnchor& anchor : skin.anchors()) {
      if (skin_owner(skin_part(skin.points()[anchor.point].body)) == hand) sum += anchor.force;
      if (skin_owner(anchor.slot) == hand) sum -= anchor.force;
    }
    return sum;
  }

  HandSimulation simulation;

 private:
  std::array<Pose, 2> wrists_;
};

}  // namespace softhand::testing
