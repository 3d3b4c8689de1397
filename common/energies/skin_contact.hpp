// Contact of a hand's skin with its own skin, and friction there. It acts between fingers, finger and palm, and thumb
// and hand. The law is that of ES2725128A1 eqs. 32 and 33, figure 4. The source leaves skin against skin out.
//
//   U = sum 1/2 k min(0, u)^2 + CoulombSpring(k min(mu, 1), mu f_n)(|T e - s_0|),   k = 1/2 k_c A
//   u = n . e,   e = R^T (x_p - x_t) - a,   T = 1 - n n^T
//
// x_p is a contact point of the skin with area A (contact/contact_point.hpp). R is the orientation of a triangle of the
// skin, and x_t its place (contact/skin_frame.hpp). In this frame, a is the anchor on the triangle and n its normal.
// Degrees of freedom: the nodes of the point and the corners of the triangle. Units: J, m, m^2, N, N/m^3.
//
// The anchor follows the law of contact with objects (contact/anchor_law.hpp). contact.hpp and friction.hpp list what
// that law changes in the source. The following comes in addition.
//
// Both sides of a contact have points, and both sides push. So each side has half the stiffness k_c A.
//
// The frame turns with the triangle. So the energy is invariant under a rigid motion of the hand, and all forces and
// torques balance. The projected Hessian leaves out the second derivative of the frame, as contact with objects does.
//
// Skin that is near at rest does not touch (contact/skin_patches.hpp), and a digit does not touch itself.
//
// The same law couples two hands to each other. It also couples flexible objects to hands and to each other. Each
// object is one more part of the skin.
//
// A contact begins at the first triangle that the point crosses in a step, at any speed. A point that starts inside
// moves out at 0.75 m/s at most.
//
// Skin over an inverted tetrahedron of a hand touches no skin. It looks inward, so its contacts would pull the parts
// into each other and invert more tissue.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "contact/anchor_law.hpp"
#include "contact/collider.hpp"
#include "contact/contact_point.hpp"
#include "contact/skin_search.hpp"
#include "energies/memory.hpp"
#include "model/tissue_model.hpp"

namespace softhand {

/// An anchor on the skin. `slot` is the part of the skin that it is on (`skin_part`).
struct SkinAnchor : ContactAnchor {
  std::int32_t triangle = 0;  ///< of TissueModel::surface
};

class SkinContact final : public EnergyWithMemory<SkinContact> {
 public:
  /// Contact of a hand with itself, or, if `model` has several owners of skin, between them (contact/skin_patches.hpp).
  /// `stiffness` is k_c, N/m^3. `friction` is Coulomb's mu of the skin of hands, >= 0. `object_frictions`: by flexible
  /// object. It holds for contact with a hand. Two objects have the geometric mean. `node_masses` (kg) are used only to
  /// estimate the normal force of a fresh contact. `name`: of the term, a literal. Throws std::invalid_argument if k_c
  /// or a mu is out of range.
  SkinContact(const TissueModel& model, const std::vector<double>& node_masses, double stiffness, double friction,
              std::vector<double> object_frictions = {}, std::string_view name = "skin");

  std::string_view name() const override { return name_; }
  bool has_kinks() const override { return true; }
  void add_pattern(BlockPattern& pattern) const override;
  void bind(const BlockMatrix& matrix) override;
  void begin_step(const State& state, double time_step) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  bool revise(const State& state) override;
  void end_step(State& state) override;
  void cancel_step() override;
  EnergyFlow flow(double, double, double) const override { return flow_; }

  struct Memory {
    struct Item {
      AnchorMemory anchor;
      std::int32_t triangle = 0;
    };
    std::vector<Item> anchors;           // in the order in which they began
    std::uint32_t passing = 0;           // one bit for each flexible object, and kHands
    bool is_deep = true;                 // points may be far inside another part
    double dissipated = 0, cleared = 0;  // J
  };
  const Memory& save() const;
  /// Throws std::invalid_argument if the memory is that of another hand.
  void load(const Memory& memory);
  /// All contacts end. Call it after nodes were teleported. The next step looks for points that are far inside.
  void reset();
  /// Ends the contacts of all nodes that are not in `state` where the last step left them: those of their points and
  /// of their triangles. Call it after nodes were put elsewhere. The next step looks for points that are far inside.
  void release_moved(const State& state);
  /// While `on`, no contact begins between the hands and a flexible object. Present contacts stay.
  void set_passing(int object, bool on);
  bool passing(int object) const { return (passing_ >> object & 1U) != 0; }
  /// The same for contacts between two hands. Afterwards the next step looks for points that are far inside.
  void set_hands_passing(bool on);

  /// In the order in which they began.
  std::span<const SkinAnchor> anchors() const { return anchors_; }
  const ContactPoints& points() const { return points_; }
  const SkinSearch& search() const { return search_; }
  AnchorOffset offset(const SkinAnchor& anchor, const State& state) const {
    return anchor_law::offset(anchor, search_.frame(anchor.triangle, state.node_positions).pose,
                              points_.at(anchor.point, state.node_positions));
  }
  /// Largest penetration in `state`, m. 0 without contact.
  double deepest_penetration(const State& state) const;
  /// Heat of sliding since construction, J.
  double dissipated() const { return dissipated_; }
  /// Number of anchors since construction that were dropped because the list was full.
  std::uint64_t dropped() const { return dropped_; }

 private:
  static constexpr int kHands = 31;  // bit of `passing_`; there are fewer flexible objects

  std::uint8_t& has_anchor(int point, int part) {
    return has_anchor_[static_cast<std::size_t>(point) * static_cast<std::size_t>(search_.patches().part_count()) +
                       static_cast<std::size_t>(part)];
  }
  double friction_of(int point, int part) const;
  bool cannot_begin(int point, int part);
  bool is_inverted(int point, int triangle) const;
  SkinAnchor* create(const SkinCandidate& candidate);
  void begin_anchor(SkinAnchor& anchor, const Vector3& end, const Eigen::Matrix3Xd& end_positions);
  template <typename Found>
  void find_crossed(const State& state, Found&& found);
  template <typename Ends>
  void remove_if(Ends&& ends);
  bool clear(const SkinAnchor& anchor);
  void mark_anchors();
  void account(SkinAnchor& anchor, const SkinFrame& frame, const AnchorOffset& end, const Vector3& push,
               const Vector3& drag, const State& state);
  void settle(SkinAnchor& anchor, const AnchorOffset& offset);
  bool slide(SkinAnchor& anchor, double drag, const SkinFrame& frame, const State& state);
  bool follow(SkinAnchor& anchor, const Vector3& place, const State& state);
  void scatter_exact(const SkinAnchor& anchor, const State& state, BlockMatrix& hessian) const;
  void scatter(const SkinAnchor& anchor, const Matrix3& of_point, const std::array<Matrix3, 3>& of_corners,
               const std::array<Matrix3, 6>& between_corners, BlockMatrix& hessian) const;

  std::string_view name_;
  double stiffness_, friction_;
  std::vector<double> object_frictions_;  // by flexible object
  std::vector<double> node_masses_;
  ContactPoints points_;
  PointBlocks blocks_;
  SkinSearch search_;
  std::vector<std::array<BlockSlot, 6>> corner_blocks_;  // by triangle: (0,0), (1,0), (1,1), (2,0), (2,1), (2,2)
  std::vector<SkinAnchor> anchors_;
  std::vector<std::uint8_t> has_anchor_;                                     // by (point, part)
  std::vector<std::array<std::int32_t, 4>> behind_point_, behind_triangle_;  // corners of the tetrahedron
  std::uint32_t passing_ = 0;
  double time_step_ = 0;
  bool is_deep_ = true;
  bool found_deep_ = false;  // in this step: the next one looks for points that are far inside
  double dissipated_ = 0;
  double cleared_ = 0;  // energy of the contacts removed since the last step, J
  // For `cancel_step`: as before the step.
  bool in_step_ = false;
  std::vector<SkinAnchor> anchors_before_;
  double cleared_before_ = 0;
  mutable Memory saved_;
  EnergyFlow flow_;
  std::uint64_t dropped_ = 0;
};

}  // namespace softhand
