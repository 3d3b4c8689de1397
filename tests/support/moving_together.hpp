// The palm of the block hand over a block, both with a common velocity. Either the block's motion is given, or the
// block rests on a plane.
#pragma once

#include "messages/convert.hpp"
#include "scene/hand_simulation.hpp"
#include "support/block_hand.hpp"
#include "support/shapes.hpp"

namespace softhand::testing {

class MovingTogether {
 public:
  static constexpr double kStep = 1.0 / 90;  // s

  /// `gap` (m) is between palm and block. The palm's target is lower by `depth` (m).
  MovingTogether(const Vector3& velocity, double gap, double depth, const SimulationOptions& options,
                 bool is_free = false)
      : velocity_(velocity), gap_(gap), depth_(depth), is_free_(is_free), simulation_(block_hand(1), options, 1, 0) {
    simulation_.set_slot(0, {7, &geometry_, 0.05, Matrix3::Identity() * 1.3e-5, 0.8});
    State state = simulation_.state();
    state.node_velocities.colwise() += velocity;
    for (std::size_t b = 0; b < kBodyCount; ++b) state.body_velocities[b].linear = velocity;
    simulation_.restore(state);
  }
  /// Makes the next step, in which the hand's target is `across` metres along the block.
  StepReport step(double across = 0) {
    const Vector3 start(travelled());
    ++steps_;
    const Pose block{Vector3(-0.012, -0.018 - 0.02 - gap_, -0.092) + start, Quaternion::Identity()};
    if (!is_free_ || steps_ == 1) simulation_.set_slot_motion(0, block, {velocity_, Vector3::Zero()});
    if (is_free_) {
      NeighbourPlane plane;
      plane.neighbour = 2;
      plane.point = to_wire(block * Vector3(0, -0.02, 0));
      plane.normal = {0, 1, 0};
      plane.velocity = to_wire(velocity_);
      plane.friction = 0.3;
      simulation_.make_dynamic(0, Vector3(0, -9.81, 0));
      simulation_.set_planes(0, {&plane, 1});
    }
    const Vector3 shift = Vector3(across, -depth_, 0) + travelled();
    for (int b = 0; b < kBodyCount; ++b) {
      const Body body = static_cast<Body>(b);
      Pose target = simulation_.hand().rest_joints[static_cast<std::size_t>(index_of(joint_of(body)))];
      target.position += shift;
      simulation_.set_target(body, target, {velocity_, Vector3::Zero()});
    }
    return simulation_.step(kStep);
  }
  /// Force of the hand on the block, N.
  Vector3 force() const { return simulation_.contact_wrench(0).force; }
  /// Node positions without the common motion.
  Eigen::Matrix3Xd nodes() const { return simulation_.state().node_positions.colwise() - travelled(); }
  const HandSimulation& simulation() const { return simulation_; }

 private:
  Vector3 travelled() const { return steps_ * kStep * velocity_; }

  const ShapeGeometry geometry_{cube_shape(0.02)};
  Vector3 velocity_;
  double gap_, depth_;
  bool is_free_;
  HandSimulation simulation_;
  int steps_ = 0;
};

}  // namespace softhand::testing
