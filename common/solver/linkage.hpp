// Maps increments of jointed bodies and their attached nodes from an earlier state to a later state.
//
// A Hessian that was computed at an earlier state is a good Hessian of a later state if its blocks are rotated along:
// A_now ~ G^-T A_then G^-1. The map G takes an increment at the earlier state to an increment at the later state. Both
// increments stretch the same springs equally. It is not enough to rotate each block with its own body. Two bodies that
// rotated differently would then separate at their joint, and joints are the stiffest springs. So G preserves the
// increment of a body *relative to its parent at their joint*. It also preserves the increment of an attached node
// relative to its body.
//
//   rotation       Phi_b = W_b phi_b,   W_b = R_b,now (R_b,then)^T
//   translation    T_b = T_a + W_a (t_b - t_a) + (W_a - W_b) (phi_b x r_b)
//   attached node  Y_n = T_b + W_b (y_n - t_b)
//
// Small letters are increments at the earlier state, capitals at the later state. The parent of b is a. The lever r_b
// goes from the centre of mass of b to the joint. It is taken at the earlier state, in world axes.
//
// The map is exact in three cases: all bodies rotated equally, the springs of joints, and everything between one body
// and its attached nodes.
#pragma once

#include <cstdint>
#include <vector>

#include "model/state.hpp"

namespace softhand {

class Linkage {
 public:
  struct Link {
    int parent = -1;                  ///< a body with a smaller index; -1: no parent
    Vector3 joint = Vector3::Zero();  ///< in the body's own frame
  };
  /// No joints, and no node is attached: `move` moves everything along straight lines.
  explicit Linkage(DofLayout layout) : layout_(layout), tangent_(VectorX::Zero(layout.dof_count())) { resize_bodies(); }
  /// `links`: for the first bodies of the state. The other bodies have no joints. `node_bodies`: by node, the body that
  /// the node is attached to; -1: none, so it moves along a straight line. Throws std::invalid_argument if an index is
  /// out of range.
  Linkage(DofLayout layout, std::vector<Link> links, std::vector<std::int32_t> node_bodies);

  int linked_bodies() const { return static_cast<int>(links_.size()); }
  /// No body touches an object.
  void clear_touching();
  /// This body touches an object. So `move` moves the body, its ancestors and their attached nodes along straight
  /// lines.
  void set_touching(int body);
  /// From now on `move` moves every body along straight lines, as `apply_increment` does.
  void straighten();
  /// Something touches that is not linked: no body moves along straight lines because of it.
  void set_loose_touching() { any_touching_ = true; }
  /// Whether the body, or one whose ancestor it is, touches an object.
  bool moves_straight(int body) const { return is_straight_[static_cast<std::size_t>(body)] != 0; }
  bool any_touching() const { return any_touching_; }
  /// Moves `state` by `scale` times an increment. To first order this is `apply_increment`. But rotations are finite:
  /// a body's joint follows its parent, and an attached node turns with its body. So a large turn of a bone stretches
  /// no tissue. Touching bodies and their nodes move straight: contact is stiffer than tissue, and the increment
  /// satisfies contact only to first order.
  void move(State& state, const VectorX& increment, double scale);
  /// Derivative of the last `move` with respect to its scale.
  const VectorX& tangent() const { return tangent_; }
  /// RMS distance of the linked bodies in `state` from where they would be after `time_step` seconds with the
  /// velocities of `start`, m.
  double prediction_error(const State& start, const State& state, double time_step) const;
  /// `state` becomes the earlier state.
  void set_earlier_state(const State& state);
  /// `state` becomes the later state.
  void set_later_state(const State& state);
  /// RMS of an increment's translations, m: the larger of two values, one of the nodes and one of the linked bodies.
  double root_mean_square(const VectorX& increment) const;
  /// Largest translation of an increment, m: of all nodes and linked bodies.
  double largest_move(const VectorX& increment) const;
  /// Moves the linked bodies of `state` for `time_step` seconds at constant velocity. Their attached nodes keep their
  /// velocity relative to the body. Nodes of other bodies move at constant velocity.
  void coast(State& state, double time_step);
  /// Rotate the nodes' rows of a gradient from world axes to the axes of their bodies, and back.
  void to_bodies(const State& state, VectorX& gradient) const;
  void to_world(const State& state, VectorX& gradient) const;
  /// increment := G increment.
  void to_now(VectorX& increment);
  /// gradient := G^T gradient, from the later state to the earlier state.
  void to_then(VectorX& gradient);

 private:
  auto rotation(int body) const { return 3 * layout_.body_rotation_block(body); }
  auto translation(int body) const { return 3 * layout_.body_translation_block(body); }

  bool is_loose(std::size_t node) const { return node_bodies_[node] < 0; }
  void resize_bodies();

  DofLayout layout_;
  std::vector<Link> links_;
  std::vector<std::int32_t> node_bodies_;
  std::vector<std::uint8_t> is_straight_;  // by body: `move` moves it along a straight line
  bool any_touching_ = false;
  std::vector<Quaternion> earlier_orientations_;  // by body, orientation at the earlier state
  std::vector<Vector3> levers_;                   // by link, r_b
  std::vector<Matrix3> turns_;                    // by body, W_b
  std::vector<Matrix3> coasted_;                  // scratch, by body: the rotation of a step or of a move
  // Scratch, by body: t_b and T_b, or their gradients. In `move`: the old position and the derivative of the new one.
  std::vector<Vector3> then_, now_;
  VectorX tangent_;
};

}  // namespace softhand
