// Contact between bones that no joint holds together: of two digits, and of two hands.
//
//   U = sum 1/2 k min(0, g)^2,   g = |p - q| - r_a - r_b - c
//
// Each bone is a capsule. The places p lie along the axis of one bone, at most 3 mm apart. The point q is the nearest
// one of the other bone's axis. Both bones of a pair have places p. So the force changes smoothly when two parallel
// bones tilt. Degrees of freedom: six of each bone. Units: J, m, N/m.
//
// The tissue between two bones cannot stop them. Tissue that is pressed flat turns over. Then the bones pass through
// each other, and the skin of one digit holds on to the far side of the other. This term acts shortly before the bones
// touch: c is 1 mm. In most contacts the tissue keeps the bones farther apart, and the term is zero. Not in the
// source.
//
// Exact Hessian: everything. Projected Hessian: Gauss-Newton.
#pragma once

#include <vector>

#include "energies/energy.hpp"
#include "model/hand_model.hpp"

namespace softhand {

/// A bone of a digit: the capsule around its axis with the smaller of its two radii.
struct BoneCapsule {
  Finger finger;
  bool is_metacarpal;
  int body;            ///< index into State::body_poses
  Vector3 begin, end;  ///< in the body's frame, m
  double radius;       ///< m

  Vector3 begin_in(const State& state) const { return state.body_poses[static_cast<std::size_t>(body)] * begin; }
  Vector3 end_in(const State& state) const { return state.body_poses[static_cast<std::size_t>(body)] * end; }
};

/// All bones of the digits of a hand, in the order of its bodies. `first_body`: of the hand's bones in the state.
std::vector<BoneCapsule> bone_capsules(const HandModel& hand, int first_body = 0);

class SkeletonContact final : public Energy {
 public:
  /// `hands`: the bones of one or two hands. Within a hand, the phalanges of a digit touch all bones of other digits,
  /// if `within_hands`. Bones of two hands always touch. Throws std::invalid_argument if there are more hands.
  SkeletonContact(const std::vector<std::vector<BoneCapsule>>& hands, bool within_hands, DofLayout layout);

  /// While `on`, bones of two hands do not touch. Call it between steps.
  void set_hands_passing(bool on) { hands_pass_ = on; }

  std::string_view name() const override { return "skeleton_contact"; }
  bool has_kinks() const override { return true; }
  void add_pattern(BlockPattern& pattern) const override;
  void bind(const BlockMatrix& matrix) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;

 private:
  struct Pair {
    std::size_t first, second;  // of `bones_`
  };
  struct Bone {
    BoneCapsule capsule;
    double length;                                        // m, of the axis
    int places;                                           // along the axis
    int translation, rotation;                            // blocks
    BlockSlot on_translation, between_both, on_rotation;  // of the body
  };
  struct Touch;
  template <typename Found>
  void for_each_touch(const State& state, Found&& found) const;

  std::vector<Bone> bones_;
  std::vector<Pair> pairs_;  // those within hands first
  std::size_t pairs_within_hands_ = 0;
  bool hands_pass_ = false;
};

}  // namespace softhand
