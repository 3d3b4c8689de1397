// Increments of a jointed body with what it carries, taken from one state to another.
//
// Stiffness turns with what is stiff. A matrix of second derivatives that was made at an earlier state serves at a
// later one as well as its blocks are turned along: A_now ~ G^-T A_then G^-1, with G the map that takes increments at
// the earlier state to the increments at the later one which stretch the same springs alike. Turning each block with
// its own body would tear the joints, the stiffest springs of all: two bodies that have turned differently no longer
// meet. So a body keeps its increment *relative to its parent at their joint*, and what it carries keeps its increment
// relative to the body:
//
//   rotation     Phi_b = W_b phi_b,   W_b = R_b now (R_b then)^T translation  T_b   = T_a + W_a (t_b - t_a) + (W_a -
//   W_b)(phi_b x r_b),   a its parent, r_b from its centre of mass to the joint, then, in world axes carried      Y_n
//   = T_b + W_b (y_n - t_b)
//
// Exact where all turned alike, for the springs of joints, and for everything between one body and what it carries.
#pragma once

#include <cstdint>
#include <vector>

#include "model/state.hpp"

namespace softhand {

class Linkage {
 public:
  struct Link {
    int parent = -1;                  ///< a body with a smaller index; -1: it hangs at none
    Vector3 joint = Vector3::Zero();  ///< in the body's own frame
  };
  Linkage() = default;
  /// `links`: of the first bodies of the state; the others are each alone. `carriers`: by node, the body that carries
  /// it. std::invalid_argument where an index is out of range.
  Linkage(DofLayout layout, std::vector<Link> links, std::vector<std::int32_t> carriers);

  int linked_bodies() const { return static_cast<int>(links_.size()); }
  /// No body touches an object.
  void clear_touching();
  /// This body touches an object. So `move` moves it, what carries it and what it carries along straight lines.
  void set_touching(int body);
  /// From now on `move` moves every body along straight lines, as `apply_increment` does.
  void straighten();
  bool any_touching() const { return any_touching_; }
  /// Moves `state` by `scale` times an increment. To first order this is `apply_increment`. But rotations are finite:
  /// a body's joint follows its parent, and a carried node turns with its body. So a large turn of a bone stretches no
  /// tissue. Touching bodies and their nodes move straight, because contact is stiffer than tissue and the increment
  /// meets it to first order. `tangent`: the derivative of the move by `scale` there.
  void move(State& state, const VectorX& increment, double scale, VectorX& tangent);
  /// RMS distance of the linked bodies in `state` from where they would be after `time_step` seconds with the
  /// velocities of `start`, m.
  double prediction_error(const State& start, const State& state, double time_step) const;
  /// `state` becomes the earlier state.
  void keep(const State& state);
  /// `state` becomes the later state.
  void turn(const State& state);
  /// Of an increment's translations, m: of the nodes or of the linked bodies, whichever is more.
  double root_mean_square(const VectorX& increment) const;
  /// Moves the linked bodies of `state` on for `time_step` seconds as their velocities lead, and what they carry as it
  /// moves on them.
  void coast(State& state, double time_step);
  /// The nodes' rows of a gradient, from world axes to those of the bodies that carry them, and back.
  void to_bodies(const State& state, VectorX& gradient) const;
  void to_world(const State& state, VectorX& gradient) const;
  /// increment := G increment.
  void to_now(VectorX& increment);
  /// gradient := G^T gradient, from the later state to the earlier.
  void to_then(VectorX& gradient);

 private:
  auto rotation(int body) const { return 3 * layout_.body_rotation_block(body); }
  auto translation(int body) const { return 3 * layout_.body_translation_block(body); }

  DofLayout layout_;
  std::vector<Link> links_;
  std::vector<std::int32_t> carriers_;
  std::vector<std::uint8_t> is_straight_;  // by body
  bool any_touching_ = false;
  std::vector<Quaternion> kept_;     // by body, orientation at the earlier state
  std::vector<Vector3> levers_;      // by link, r_b
  std::vector<Matrix3> turns_;       // by body, W_b
  std::vector<Matrix3> coasted_;     // scratch, by body: the turn of a step or of a move
  std::vector<Vector3> then_, now_;  // scratch, by body: t_b and T_b, or their gradients; in `move` the old position
                                     // and the derivative of the new one
};

}  // namespace softhand
