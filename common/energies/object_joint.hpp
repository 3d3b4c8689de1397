// Joints between rigid objects: hinge, slider, ball, screw and fixed, with limits, friction, spring, damping and
// detents (model/joint_law.hpp). This is not in the source. The joints of the hand's own bones are eq. 20 (joint.hpp).
//
//   U = 1/2 k |held offsets|^2 + 1/2 k_o |held axes of the parent - those of the child|^2 (half of it for three axes)
//       + 1/2 k_q (max(0, q - max)^2 + max(0, min - q)^2) + spring(q) + detents(q)
//       + CoulombSpring(k_f, B)(|q - anchor|) + b/(2 dt) (q - q_i)^2
//
// - The offset is the place of the child's frame in the parent's frame. A screw holds the offset along the axis at
//   pitch q/(2 pi).
// - Axes are unit vectors. Their distance is 2 sin(angle/2), so energy and force are finite at any angle. A hinge and a
//   screw hold the axis +y. A slider and a fixed joint hold all three.
// - A ball joint has the coordinate 2 sin(angle/2) of its two axes for the limit. Its friction uses the same distance
//   for the whole relative rotation since the anchor. Its spring is k (1 - cos(angle of the whole relative rotation)).
// - B is the friction of the law at the reaction force of the last step, k |held offsets|. The anchor slides at the end
//   of a step, as in coulomb.hpp. If k_f changes with B, the anchor moves so that the force stays.
//
// Stiffness. A backward-Euler step moves the free bodies by F dt^2/m under a force F. With k = s m/dt^2 the joint opens
// by 1/s of that, and the largest eigenvalue of the matrix grows by 1 + s relative to inertia alone. s = 1000 keeps the
// opening under gravity at 1.2 um at 90 Hz. The float factor has 7 digits, so it keeps 4 of them. A light object needs
// more: a finger presses with up to 20 N. So k is at least 100 kN/m, which opens the joint by 0.2 mm under 20 N.
//   k = s m/dt^2, k_o = s I/dt^2, k_q = k or k_o, with s = max(1000, 100 kN/m dt^2/m),
//   1/m = 1/m_parent + 1/m_child, 1/I likewise with I = trace/3 + m |arm to the joint|^2. A static parent adds 0.
//   k_f = max(100 m/dt^2 or 100 I/dt^2, B / (0.1 mm or 2 mrad)): the elastic slide before friction slips.
//
// Projected Hessian: Gauss-Newton. Negative curvature of detents counts as 0. Degrees of freedom: six of each body. A
// parent may be static or have a prescribed motion: then only the child has unknowns. Units: J; m, rad.
#pragma once

#include <vector>

#include "contact/coulomb.hpp"
#include "energies/memory.hpp"
#include "model/joint_law.hpp"

namespace softhand {

/// A joint between bodies of the state.
struct ObjectJoint {
  JointLaw law;
  int parent = -1;         ///< index into State::body_poses; -1: the parent has a prescribed motion
  int child = 0;           ///< index into State::body_poses
  Pose parent_from_joint;  ///< the joint's frame in the parent's body frame
  Pose child_from_joint;   ///< the joint's frame in the child's body frame
  double parent_mass = 0;  ///< kg; ignored if the parent is -1
  double child_mass = 1;
  Matrix3 parent_inertia = Matrix3::Identity();  ///< kg m^2, body axes
  Matrix3 child_inertia = Matrix3::Identity();
};

class ObjectJointEnergy final : public EnergyWithMemory<ObjectJointEnergy> {
 public:
  /// Up to `places` joints between the bodies `first_body` ... `first_body + bodies - 1`. All places start empty. The
  /// pattern has all pairs of these bodies.
  ObjectJointEnergy(DofLayout layout, int first_body, int bodies, int places);

  int place_count() const { return static_cast<int>(joints_.size()); }
  /// Puts a joint into a place; its friction has no stretch at first. Throws std::invalid_argument if the law, a body
  /// or a mass is not usable.
  void set_joint(int place, const ObjectJoint& joint);
  void clear_joint(int place);
  bool is_set(int place) const { return at(place).set; }
  const ObjectJoint& joint(int place) const { return at(place).model; }
  /// Prescribed motion of a parent with index -1: its pose at the start of the next step and its velocity. It moves
  /// with this velocity until the next call. Static at the origin at first.
  void set_parent_motion(int place, const Pose& pose, const Twist& velocity = {});

  /// q. 0 for a fixed joint and a ball.
  double coordinate(int place, const State& state) const;
  /// Distance (m) of the two frames in the held directions.
  double gap(int place, const State& state) const;
  /// Angle (rad) between the held axes of the two frames; 0 for a ball.
  double misalignment(int place, const State& state) const;
  /// Wrench of all joints on a body in the last step, about its centre of mass, world axes.
  const Wrench& wrench(int body) const { return wrenches_[static_cast<std::size_t>(body - first_body_)]; }

  /// All that a step carries to the next one.
  struct Memory {
    struct Joint {
      bool stepped = false;                             // the coordinate is valid
      double coordinate = 0;                            // q at the end of the step; it tells the turns of a screw
      bool anchored = false;                            // the anchor is valid
      double anchor = 0;                                // of the friction, a value of q
      Quaternion anchor_turn = Quaternion::Identity();  // ball: relative rotation at the anchor
      double direction = 0;                             // of the last slide, -1 or 1; 0: it sticks
      double reaction = 0;                              // N, force with which the joint held its bodies together
      double friction_stiffness = 0;                    // k_f, if the friction depends on the reaction
      Pose parent;                                      // prescribed parent at the start of the next step
      Twist parent_velocity;
    };
    std::vector<Joint> joints;  // by place
    double stored = 0;          // J
  };
  const Memory& save() const { return memory_; }
  /// The same joints must be set. Throws std::invalid_argument if `memory` has another number of places.
  void load(const Memory& memory);
  /// Forgets anchors, reactions and turns, as if every joint were set anew. Prescribed parents keep their poses.
  void reset();

  std::string_view name() const override { return "object_joint"; }
  bool has_kinks() const override { return true; }
  void add_pattern(BlockPattern& pattern) const override;
  void bind(const BlockMatrix& matrix) override;
  void begin_step(const State& state, double time_step) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  void end_step(State& state) override;
  /// Friction: force times slide of the anchor. Work: of prescribed parents, and of joints that were set or cleared.
  EnergyFlow flow(double start, double end, double taken) const override;

 private:
  using Vector12 = Eigen::Matrix<double, 12, 1>;
  using Matrix12 = Eigen::Matrix<double, 12, 12>;

  struct Joint {
    bool set = false;
    ObjectJoint model;
    // Fixed within the step.
    Pose parent;  // prescribed parent at the end of the step
    double offset_stiffness = 0, axis_stiffness = 0, limit_stiffness = 0;
    CoulombSpring friction;
    double damping = 0;  // b/dt
    double start = 0;    // q at the start of the step
    double anchor = 0;
    Quaternion anchor_turn = Quaternion::Identity();
    bool slides_on = false;  // the anchor slid in the last step, and the velocity continues in the same direction
  };
  /// Adds value, gradient and Hessian of one joint. Null pointers are skipped. Blocks: parent translation, parent
  /// rotation, child translation, child rotation.
  double evaluate(const Joint& joint, const State& state, Vector12* gradient, Matrix12* hessian,
                  Curvature curvature) const;
  JointPose pose_of(const Joint& joint, const State& state, const Pose& prescribed) const;
  static double coordinate(const Joint& joint, const Memory::Joint& memory, const JointPose& pose);
  void set_friction(Joint& joint, const Memory::Joint& memory, const JointPose& pose, double least_stiffness) const;
  double friction_stretch(const Joint& joint, const JointPose& pose) const;

  Joint& at(int place) { return joints_[static_cast<std::size_t>(place)]; }
  const Joint& at(int place) const { return joints_[static_cast<std::size_t>(place)]; }
  int block(int body, bool rotation) const {
    return rotation ? layout_.body_rotation_block(body) : layout_.body_translation_block(body);
  }
  BlockSlot& slot(int row, int column) { return slots_[static_cast<std::size_t>(row * (row + 1) / 2 + column)]; }
  const BlockSlot& slot(int row, int column) const {
    return slots_[static_cast<std::size_t>(row * (row + 1) / 2 + column)];
  }

  DofLayout layout_;
  int first_body_;
  int bodies_;
  std::vector<Joint> joints_;
  std::vector<BlockSlot> slots_;  // of the lower triangle of the bodies' blocks
  std::vector<Wrench> wrenches_;  // by body
  Memory memory_;
  double time_step_ = 1;
  // For the ledger, J.
  double start_energy_ = 0, before_ = 0, heat_ = 0, parent_work_ = 0, damper_ = 0;
};

}  // namespace softhand
