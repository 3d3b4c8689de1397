// Joints between bodies (ES2725128A1 eq. 20): a position spring, and springs against the rotations that the kind of
// joint does not allow.
//
//   U = 1/2 k |x_a + r_a - x_b - r_b|^2 + sum over the held axes 1/2 k_o phi_i^2
//       + sum over the limited axes U_lim(e_i),   phi = log(Q_a^T Q_b)
//   U_lim = k_lim (2 e^3/(3 w) - e^4/(4 w^2)) for e < w, else k_lim (e^2/2 - w^2/12);   e_i: how far phi_i is out of
//   range
//
// Q_a is the parent's rest-aligned joint frame and Q_b the child's joint frame. phi is zero at rest. Its components are
// the flexion, abduction and twist of `JointModel`, in the parent's joint frame.
//
// Departure from the source: the source gives no formula for axes and ranges. We use the components of the rotation
// vector, because they treat all three axes alike and have no gimbal lock. They equal the textbook joint angles while
// only one of them is large. The stiffness of a limit grows over w = 0.02 rad, where the source gives none: a jump
// costs the solver a new factor each time a joint at its limit trembles. Beyond w the moment is k_lim e, as without a
// ramp. At a rotation of pi, phi is finite and jumps to the other arc.
//
// Projected Hessian: Gauss-Newton. Degrees of freedom: six of the parent, six of the child. Units: J; m, rad.
#pragma once

#include <vector>

#include "energies/clique.hpp"
#include "energies/energy.hpp"
#include "model/hand_model.hpp"

namespace softhand {

struct JointSite {
  int parent = 0;  ///< index into State::body_poses
  int child = 0;
  Pose parent_from_joint;  ///< the joint's frame in the parent's body frame, at rest
  Pose child_from_joint;   ///< the same frame in the child's body frame
  JointModel model;
};

/// The joints of a hand, in the order of their child bodies. Bodies of kind `free` have no joint.
std::vector<JointSite> hand_joints(const HandModel& hand);

class JointEnergy final : public Energy {
 public:
  /// Throws std::invalid_argument if a stiffness is negative or a range does not satisfy min <= 0 <= max.
  JointEnergy(const std::vector<JointSite>& sites, DofLayout layout);

  int joint_count() const { return static_cast<int>(joints_.size()); }
  const JointSite& site(int joint) const { return joints_[static_cast<std::size_t>(joint)].site; }
  /// phi in radians: flexion, abduction, twist.
  Vector3 angles(int joint, const State& state) const;

  std::string_view name() const override { return "joint"; }
  bool is_potential() const override { return true; }
  int needed_bodies() const override;
  void add_pattern(BlockPattern& pattern) const override;
  void bind(const BlockMatrix& matrix) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;

 private:
  struct Response {
    double energy = 0, moment = 0, stiffness = 0;
  };
  struct AxisLaw {
    double stiffness = 0;  // acts outside [minimum, maximum]
    double minimum = 0;
    double maximum = 0;
    Response at(double angle) const;
  };
  struct JointData {
    JointSite site;
    std::array<AxisLaw, 3> axes;
    Clique<4> blocks;  // blocks: parent translation, parent rotation, child translation, child rotation
  };
  std::vector<JointData> joints_;
};

}  // namespace softhand
