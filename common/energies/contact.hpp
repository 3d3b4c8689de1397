// Contact of skin nodes with objects: the anchors (figure 4) and the normal energy U_n (ES2725128A1 eq. 32).
//
//   U_n = sum 1/2 k_c w min(0, u)^2,   u = n . e,   e = R^T (x_n - x_b) - a
//
// a and n are the anchor and its outward normal in the object's frame, (x_b, R) the object's body, w = nodal area /
// mean nodal area. Degrees of freedom: the node; translation and rotation of the object's body where it yields. Units:
// J, m, N/m.
//
// Departures from the source.
// - eq. 32 measures n n^T (x_a - x_n) with n in the world. Here n turns with the object, so that the energy is
//   invariant under a rigid motion of both and force and torque balance exactly: the object takes the opposite of the
//   node's force where the node is.
// - One-sided (n . (x_n - x_a) < 0): a contact pushes. Exception: a node that is about to cross within the step has its
//   anchor put at the crossing already at the step's start, and for this one step it holds two-sidedly. Otherwise a
//   step of one Newton iteration, which starts at the state before the crossing, would not feel it, and a tip at 1 m/s
//   would sink 11 mm before the first force.
// - A node that starts inside is anchored at itself, and the anchor moves out to the nearest surface point at 1 m/s at
//   most.
// - The plane is frozen within a step, but of an anchor that slides over a curved surface it is the plane ahead, where
//   the node's velocity takes it: the one behind would lift a node at 0.5 m/s off a finger-thick cylinder (v dt)^2 / 2R
//   = 0.8 mm, and the contact would chatter.
// - A fixed object moves within the step by its velocity. The energy takes the pose of the step's end, like the
//   positions that it is a function of. What concerns the step's start takes the pose of the start: paths, and the
//   friction's bound. So only relative motion counts.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "energies/energy.hpp"
#include "geometry/node_groups.hpp"
#include "geometry/shape.hpp"
#include "messages/messages.hpp"
#include "model/hand_model.hpp"

namespace softhand {

/// How an object's slot takes part.
enum class ContactObject : std::uint8_t {
  moving,  ///< the object yields: its body's degrees of freedom take the opposite force
  fixed,   ///< its motion is given: the state's pose is that of the step's start; the wrench is reported only
};

/// The touched nodes of one hand: creates, slides and ends anchors. `ContactEnergy` drives it (begin_step, end_step);
/// `FrictionEnergy` reads it and comes after `ContactEnergy` in the list of terms. Nothing after the terms are bound
/// allocates.
class ContactSet {
 public:
  /// One touching (or about to touch) node. Vectors in the object's frame unless said otherwise.
  struct Anchor {
    std::int32_t node = 0;
    std::int32_t slot = 0;
    Vector3 anchor = Vector3::Zero();   ///< a: the surface point, drawn in by `recess`
    Vector3 normal = Vector3::UnitY();  ///< n
    double recess = 0;                  ///< m still to move out, of a node that started inside
    double stiffness = 0;               ///< k_c w, N/m
    double friction = 0;                ///< mu
    double friction_stiffness = 0;      ///< k_c w min(mu, 1), N/m
    // Fixed within the step.
    bool fresh = false;           ///< about to cross: two-sided
    bool sliding = false;         ///< slid in the last step and still moves that way
    bool ahead = false;           ///< anchor and normal are those that the node slides to
    double friction_bound = 0;    ///< mu f_n, N, f_n from the step's start
    double predicted_secant = 0;  ///< of the friction of a fresh anchor at the predicted end of the step, N/m
    Vector3 stretch_origin = Vector3::Zero();  ///< tangential stretch that counts as none (fresh, ahead; else zero)
    Vector3 stretch_start = Vector3::Zero();   ///< tangential stretch at the step's start
    // As between steps; what a step begins with.
    Vector3 kept_anchor = Vector3::Zero();
    Vector3 kept_normal = Vector3::UnitY();
    double kept_recess = 0;
    bool kept_sliding = false;
    // Results of the last step.
    Vector3 force = Vector3::Zero();  ///< on the node, N, world
    double slip_speed = 0;            ///< m/s
    // For the energy ledger.
    bool known = false;          ///< was there at the end of the last step
    double normal_energy = 0;    ///< 1/2 k min(0, u)^2 as the last step left it, J
    double friction_energy = 0;  ///< 1/2 k_t |s|^2, |s| at most mu f_n / k_t, likewise
    double start_energy = 0;     ///< normal, with the plane of this step, J
    double start_excess = 0;     ///< of |s| over what `friction_energy` holds, m
  };

  /// Objects are the bodies `first_body` ... `first_body + slots - 1` of the state; the first `moving_slots` of them
  /// may yield. `stiffness` is k_c, N/m of a mean node. `node_masses` (kg) serve only the estimate of a fresh contact's
  /// normal force. Throws std::invalid_argument when k_c is not finite and > 0.
  ContactSet(const HandModel& hand, std::vector<double> node_masses, double stiffness, int first_body, int moving_slots,
             int slots);

  /// Puts an object into a slot, or changes its friction; contacts stay when shape and id are the same. `geometry`
  /// outlives its stay. `friction` is Coulomb's mu, >= 0.
  void set_object(int slot, const ShapeGeometry* geometry, double friction, std::uint32_t id, ContactObject kind);
  /// Ends its contacts.
  void clear_object(int slot);
  /// The hand was moved at one stroke: all contacts end, no path is drawn from where it was.
  void reset();

  // For nodes that are put elsewhere at one stroke. `nodes`: by node, 1 where meant; `bones`: by node, a point of its
  // bone, world.
  /// Marks in `hooked` (by node) the nodes that a contact pushes straight away from their bones: they are on the far
  /// side of the object.
  void mark_hooked(const State& state, const Eigen::Matrix3Xd& bones, std::span<std::uint8_t> hooked) const;
  /// How far a skin node comes on the way from its bone to `to`: up to the first surface. Other nodes come to `to`.
  Vector3 stopped(const State& state, std::int32_t node, const Vector3& bone, const Vector3& to) const;
  /// J that the nodes hold in U_n and U_f since the last step.
  double held(std::span<const std::uint8_t> nodes) const;
  /// J that they would hold where they are in `state`: contacts that do not hook go on, and what is inside an object is
  /// pushed out. Infinite where a node's bone is inside an object.
  double held_where_put(const State& state, std::span<const std::uint8_t> nodes, const Eigen::Matrix3Xd& bones) const;
  /// Ends their contacts. No path is drawn from where they were: a step sees where it starts.
  void release(std::span<const std::uint8_t> nodes);

  /// A step that began and never ended (refused, failed) leaves no trace in the next.
  void begin_step(const State& state, double time_step);
  void end_step(const State& state);
  void add_pattern(BlockPattern& pattern) const;
  void bind(const BlockMatrix& matrix);

  /// In the order in which they began.
  std::span<const Anchor> anchors() const { return anchors_; }
  int count() const { return static_cast<int>(anchors_.size()); }
  int count(int slot) const { return at(slot).count; }
  /// Of the hand on the object in the last step, about its centre of mass, world axes.
  const Wrench& wrench(int slot) const { return at(slot).wrench; }
  /// k-th of 0..1 of the penetrations now (1: the largest), metres; 0 without contact. Sorts a copy; allocates nothing.
  double penetration_quantile(const State& state, double fraction);
  /// Heat of sliding since construction, J.
  double dissipated() const { return dissipated_; }
  /// Of the step that ended last: of U_n, whose energy counts where a contact pushes, and of U_f.
  const EnergyFlow& normal_flow() const { return normal_flow_; }
  const EnergyFlow& friction_flow() const { return friction_flow_; }
  /// Searches for where a node meets an object since construction: closest points and crossings.
  std::uint64_t queries() const { return queries_; }
  /// Anchors that found no room since construction.
  std::uint64_t dropped() const { return dropped_; }
  /// Contacts and sums per finger, at the end of the last step. Leaves key and stamp alone.
  void write(const State& state, Contacts& out);

  /// e = R^T (x_n - x_b) - a in world axes, with what its derivatives need.
  struct Offset {
    Vector3 offset;    ///< R e
    Vector3 normal;    ///< R n
    Vector3 lever;     ///< x_n - x_b
    double depth = 0;  ///< u; negative: penetrating
    Vector3 stretch;   ///< R (T e - s_0), tangential
    double moved = 0;  ///< of the stretch since the step's start, m
  };
  Offset offset(const Anchor& anchor, const State& state) const;
  /// Gradient and Hessian of a function of e with gradient y (N, world axes) and stiffness K (N/m).
  void scatter_gradient(const Anchor& anchor, const Vector3& lever, const Vector3& y, VectorX& gradient) const;
  void scatter_hessian(const Anchor& anchor, const Vector3& lever, const Vector3& y, const Matrix3& stiffness,
                       BlockMatrix& hessian, Curvature curvature) const;

 private:
  struct Slot {
    const ShapeGeometry* geometry = nullptr;
    double friction = 0;
    std::uint32_t id = 0;
    ContactObject kind = ContactObject::fixed;
    bool seen = false;    // last_pose holds
    Pose last_pose;       // at the end of the last step
    Pose start_pose;      // at the start of this one
    bool jumped = false;  // between the two: it was moved from outside
    Pose end_pose;        // at the end of this one, by its twist: exact of a fixed object, predicted of a moving one
    Vector3 moved = Vector3::Zero(), turned = Vector3::Zero();  // within the step, by the solver
    Wrench wrench;
    int count = 0;
    BlockSlot translation, rotation_translation, rotation;
  };
  struct NodeSlots {
    BlockSlot translation, rotation;
  };

  Slot& at(int slot) { return slots_[static_cast<std::size_t>(slot)]; }
  const Slot& at(int slot) const { return slots_[static_cast<std::size_t>(slot)]; }
  std::size_t pair(int slot, std::int32_t node) const;
  Pose body_pose(int slot, const State& state) const;
  double reach(const Slot& slot, const Pose& from, const Pose& to) const;
  Anchor* create(int slot, std::int32_t node, const Vector3& point, const Vector3& normal);
  template <typename Ends>
  void remove_if(Ends&& ends);
  void begin_anchor(Anchor& anchor, const State& state);
  const Pose& pose_before(const Anchor& anchor) const;
  bool sweep(Anchor& anchor, const Vector3& start, const Vector3& end, double limit);
  static bool same_side(const Pose& from, const Vector3& before, const Pose& to, const Vector3& now);
  static bool turns_far(const Pose& from, const Pose& to);
  static std::optional<Crossing> meeting(const Slot& slot, const Vector3& start, const Vector3& end);
  static bool only_turns_past(const ShapeGeometry& geometry, const Pose& from, const Pose& to, const Vector3& start,
                              const Vector3& end);
  void find_candidates(int slot, const State& state);
  void find_missed(int slot, const State& state);
  void slide(Anchor& anchor, double drag, const State& state);
  double normal_energy(const Anchor& anchor, double depth) const;
  bool hooks(const Anchor& anchor, const State& state, const Eigen::Matrix3Xd& bones) const;
  bool clear(const Anchor& anchor);
  void account(Anchor& anchor, const Offset& end, const Vector3& push, const Vector3& drag, const State& state);
  void settle(Anchor& anchor, const Offset& offset);

  double stiffness_;
  int first_body_;
  int moving_slots_;
  int node_count_;
  std::vector<double> node_masses_;
  std::vector<std::int32_t> skin_nodes_;
  std::vector<std::int32_t> skin_index_;  // by node, -1 inside
  std::vector<double> areas_;             // by skin index, m^2
  std::vector<double> weights_;           // by skin index, w
  std::vector<std::uint8_t> bodies_;      // by skin index
  NodeGroups groups_;
  std::vector<Slot> slots_;
  std::vector<Anchor> anchors_;
  std::vector<std::uint8_t> has_anchor_;  // by (slot, skin index)
  std::vector<NodeSlots> node_slots_;     // by (moving slot, skin index)
  std::vector<BlockSlot> node_diagonal_;  // by skin index
  std::vector<double> sorted_;
  std::vector<double> finger_forces_;  // by (finger, slot)
  Eigen::Matrix3Xd start_positions_;
  Eigen::Matrix3Xd displacements_;
  double time_step_ = 0;
  bool in_step_ = false;
  double dissipated_ = 0;
  std::uint64_t dropped_ = 0;
  EnergyFlow normal_flow_, friction_flow_;
  double cleared_normal_ = 0, cleared_friction_ = 0;  // J that contacts held which were taken away since the last step
  std::uint64_t queries_ = 0;
};

/// U_n of all anchors, and the driver of the set.
class ContactEnergy final : public Energy {
 public:
  explicit ContactEnergy(ContactSet& contacts) : contacts_(contacts) {}
  std::string_view name() const override { return "contact"; }
  bool has_kinks() const override { return true; }
  void add_pattern(BlockPattern& pattern) const override { contacts_.add_pattern(pattern); }
  void bind(const BlockMatrix& matrix) override { contacts_.bind(matrix); }
  void begin_step(const State& state, double time_step) override { contacts_.begin_step(state, time_step); }
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  void end_step(State& state) override { contacts_.end_step(state); }
  EnergyFlow flow(double, double, double) const override { return contacts_.normal_flow(); }

 private:
  ContactSet& contacts_;
};

}  // namespace softhand
