// A flexible object that no hand owns, simulated by the world's process (docs/soft-objects.md). It has the terms and
// the solver of the hand's process, so it looks the same whoever simulates it. It touches the world's static objects,
// and nothing else.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "energies/contact.hpp"
#include "energies/friction.hpp"
#include "energies/inertia.hpp"
#include "energies/node_coupling.hpp"
#include "energies/tissue.hpp"
#include "geometry/shape.hpp"
#include "model/soft_object.hpp"
#include "solver/newton_solver.hpp"

namespace softhand {

/// An object that stays where it is.
struct Obstacle {
  const ShapeGeometry* shape = nullptr;  ///< null: it was removed
  Pose pose;
  double friction = 0;  ///< of the contact with the object
};

/// Of mode symmetric, for the whole object.
struct NodeSpring {
  double stiffness = 0;  ///< N/m
  double damping_ratio = 0;
};

class FreeSoftBody {
 public:
  /// At most `obstacles` obstacles. The spring of mode symmetric exists if its stiffness is not zero.
  FreeSoftBody(const SoftObject& object, int obstacles, const NodeSpring& spring);

  /// Of the nodes, kg.
  const std::vector<double>& masses() const { return masses_; }
  void set_obstacle(int number, const Obstacle& obstacle);
  /// Puts the nodes somewhere. Drops all that a step carries to the next one. Does not allocate.
  void start(const Eigen::Matrix3Xd& positions, const Eigen::Matrix3Xd& velocities);
  /// Mode symmetric: a spring pulls each node towards the hand's, which are here at the end of the next step.
  void pull_to(const Eigen::Matrix3Xd& positions, const Eigen::Matrix3Xd& velocities) {
    coupling_->set_target(positions, velocities);
  }
  void let_go() {
    if (coupling_) coupling_->clear_target();
  }
  /// Returns false, and changes nothing, if the step fails. Does not allocate.
  bool step(double dt);
  const Eigen::Matrix3Xd& positions() const { return state_.node_positions; }
  const Eigen::Matrix3Xd& velocities() const { return state_.node_velocities; }
  /// Number of inverted tetrahedra.
  int inverted_elements() const { return tissue_.inverted_elements(state_); }

 private:
  TissueModel model_;
  std::vector<double> masses_;
  State state_;
  Inertia inertia_;
  Tissue tissue_;
  ContactSet contacts_;
  ContactEnergy contact_;
  FrictionEnergy friction_;
  std::unique_ptr<NodeCoupling> coupling_;  // null in mode owner
  std::unique_ptr<NewtonSolver> solver_;
};

}  // namespace softhand
