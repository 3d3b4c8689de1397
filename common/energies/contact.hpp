// Contact of skin nodes with objects: the anchors (figure 4) and the normal energy U_n (ES2725128A1 eq. 32).
//
//   U_n = sum 1/2 k_c w min(0, u)^2,   u = n . e,   e = R^T (x_n - x_b) - a
//
// a and n are the anchor and its outward normal in the object's frame. (x_b, R) is the object's body. w = nodal area /
// mean nodal area. Degrees of freedom: the node, and the translation and rotation of the object's body if the object
// is movable. Units: J, m, N/m.
//
// Departures from the source:
//
// - In eq. 32, n n^T (x_a - x_n) uses an n that is fixed in the world. Here n rotates with the object, so the energy is
//   invariant under a rigid motion of node and object. Then force and torque balance exactly: the opposite of the
//   node's force acts on the object at the node's position.
// - A contact is one-sided (n . (x_n - x_a) < 0): it only pushes. Exception: a node that is predicted to cross the
//   surface within the step. Its anchor is put at the crossing at the step's start. It is two-sided until an iteration
//   has moved the node. Otherwise the first iteration would miss the contact, because it starts before the crossing.
//   Then a tip at 1 m/s would sink 11 mm.
// - Contact is revised after iterations: a node that crossed a surface without being predicted to gets an anchor at the
//   crossing, and no anchor is two-sided any more.
// - A node that starts inside is anchored at its own position. The anchor then moves out to the nearest surface point,
//   at 1 m/s at most.
// - The plane is frozen within a step. If an anchor slides over a curved surface, the plane is the one ahead, at the
//   position that the node's velocity predicts. The plane behind would lift a node at 0.5 m/s off a finger-thick
//   cylinder by (v dt)^2 / 2R = 0.8 mm, and the contact would chatter.
// - A fixed object moves within the step by its velocity. The energy uses the pose at the step's end, because it is a
//   function of the positions at the step's end. Paths and the friction bound use the pose at the step's start. So only
//   relative motion counts.
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

/// How the object in a slot reacts to contact.
enum class ContactObject : std::uint8_t {
  moving,  ///< movable: the opposite force acts on the degrees of freedom of its body
  fixed,   ///< prescribed motion: the state has the pose of the step's start; the wrench is only reported
};

/// The touched nodes of one hand. Creates, slides and ends anchors. `ContactEnergy` calls begin_step and end_step.
/// `FrictionEnergy` only reads the set, and must come after `ContactEnergy` in the list of terms. After the terms are
/// bound, nothing allocates.
class ContactSet {
 public:
  /// One touching (or about to touch) node. Vectors in the object's frame unless said otherwise.
  struct Anchor {
    std::int32_t node = 0;
    std::int32_t slot = 0;
    Vector3 anchor = Vector3::Zero();   ///< a: the surface point, moved inwards by `recess`
    Vector3 normal = Vector3::UnitY();  ///< n
    double recess = 0;              ///< distance that the anchor of a node that started inside must still move out, m
    double stiffness = 0;           ///< k_c w, N/m
    double friction = 0;            ///< mu
    double friction_stiffness = 0;  ///< k_c w min(mu, 1), N/m
    // Fixed within the step.
    bool fresh = false;           ///< began in this step, before the node reached the surface
    bool missed = false;          ///< found at the end of the last step: its normal force is not known yet
    bool two_sided = false;       ///< predicted to cross in this step, and no iteration has moved the node yet
    bool sliding = false;         ///< slid in the last step and still moves in that direction
    bool ahead = false;           ///< anchor and normal are at the point to which the node slides
    double friction_bound = 0;    ///< mu f_n, N, with f_n from the step's start
    double predicted_secant = 0;  ///< secant of a fresh anchor's friction at the predicted end of the step, N/m
    Vector3 stretch_origin = Vector3::Zero();  ///< tangential stretch that exerts no force (fresh, ahead; else zero)
    Vector3 stretch_start = Vector3::Zero();   ///< tangential stretch at the step's start
    // Values between steps. Each step starts from them.
    Vector3 saved_anchor = Vector3::Zero();
    Vector3 saved_normal = Vector3::UnitY();
    double saved_recess = 0;
    bool saved_sliding = false;
    // Results of the last step.
    Vector3 force = Vector3::Zero();  ///< on the node, N, world
    double slip_speed = 0;            ///< m/s
    // For the energy ledger.
    bool known = false;          ///< existed at the end of the last step
    double normal_energy = 0;    ///< 1/2 k min(0, u)^2 at the end of the last step, J
    double friction_energy = 0;  ///< 1/2 k_t |s|^2 at the end of the last step, J; |s| is at most mu f_n / k_t
    double start_energy = 0;     ///< normal energy at the step's start, with the plane of this step, J
    double start_excess = 0;     ///< excess of |s| over the stretch stored in `friction_energy`, m
  };

  /// Objects are the bodies `first_body` ... `first_body + slots - 1` of the state. The first `moving_slots` of them
  /// may be movable. `stiffness` is k_c, N/m, of a node with the mean area. `node_masses` (kg) are used only to
  /// estimate the normal force of a fresh contact. Throws std::invalid_argument if k_c is not finite and > 0.
  ContactSet(const HandModel& hand, std::vector<double> node_masses, double stiffness, int first_body, int moving_slots,
             int slots);

  /// Puts an object into a slot, or changes its friction. Contacts persist if shape and id are the same. `geometry`
  /// must outlive its time in the slot. `friction` is Coulomb's mu, >= 0.
  void set_object(int slot, const ShapeGeometry* geometry, double friction, std::uint32_t id, ContactObject kind);
  /// Removes the object and ends its contacts.
  void clear_object(int slot);
  /// Call this after the hand was teleported. All contacts end, and no path starts at the old positions.
  void reset();

  // For nodes that are teleported. `nodes`: by node, 1 for the nodes concerned. `bones`: by node, a point of its bone,
  // world.
  /// Marks in `hooked` (by node) the nodes that a contact pushes straight away from their bones: they are on the far
  /// side of the object.
  void mark_hooked(const State& state, const Eigen::Matrix3Xd& bones, std::span<std::uint8_t> hooked) const;
  /// The end of a skin node's path from its bone to `to`: the first surface that it meets, otherwise `to`. For inner
  /// nodes always `to`.
  Vector3 stopped(const State& state, std::int32_t node, const Vector3& bone, const Vector3& to) const;
  /// Whether a node may reach the object in the next step, if its velocity relative to the object at most doubles.
  /// `time_step`: s. Call between steps, with the object's pose and velocity for the next step in `state`.
  bool may_touch(int slot, const State& state, double time_step);
  /// Energy of the nodes in U_n and U_f at the end of the last step, J.
  double stored_energy(std::span<const std::uint8_t> nodes) const;
  /// Energy that the nodes would have at their positions in `state`, J. Contacts that do not hook persist, and nodes
  /// inside an object are pushed out. Infinite if a node's bone is inside an object.
  double stored_energy_at(const State& state, std::span<const std::uint8_t> nodes, const Eigen::Matrix3Xd& bones) const;
  /// Ends the contacts of the nodes. No path starts at the old positions: the next step uses the positions at its
  /// start.
  void release(std::span<const std::uint8_t> nodes);

  /// A step that began and did not end (refused or failed) has no effect on the next step.
  void begin_step(const State& state, double time_step);
  /// `Energy::revise`: adds the nodes that crossed a surface between the step's start and `state`. Fresh anchors that
  /// would pull become one-sided.
  bool revise(const State& state);
  void end_step(const State& state);
  void add_pattern(BlockPattern& pattern) const;
  void bind(const BlockMatrix& matrix);

  /// In the order in which they began.
  std::span<const Anchor> anchors() const { return anchors_; }
  int count() const { return static_cast<int>(anchors_.size()); }
  int count(int slot) const { return at(slot).count; }
  /// Wrench of the hand on the object in the last step, about the object's centre of mass, world axes.
  const Wrench& wrench(int slot) const { return at(slot).wrench; }
  /// Quantile `fraction` (0 to 1; 1: the largest) of the penetrations in `state`, metres. 0 without contact. Sorts a
  /// copy. Does not allocate.
  double penetration_quantile(const State& state, double fraction);
  /// Heat of sliding since construction, J.
  double dissipated() const { return dissipated_; }
  /// Energy flows of U_n and U_f in the last step. The energy of U_n counts only while a contact pushes.
  const EnergyFlow& normal_flow() const { return normal_flow_; }
  const EnergyFlow& friction_flow() const { return friction_flow_; }
  /// Number of searches for a contact point since construction: closest points and crossings.
  std::uint64_t queries() const { return queries_; }
  /// Number of anchors since construction that were dropped because the list was full.
  std::uint64_t dropped() const { return dropped_; }
  /// Writes contacts and sums per finger at the end of the last step. Does not write key and stamp.
  void write(const State& state, Contacts& out);

  /// e = R^T (x_n - x_b) - a in world axes, with the values that its derivatives need.
  struct Offset {
    Vector3 offset;    ///< R e
    Vector3 normal;    ///< R n
    Vector3 lever;     ///< x_n - x_b
    double depth = 0;  ///< u; negative: penetrating
    Vector3 stretch;   ///< R (T e - s_0), tangential
    double moved = 0;  ///< change of the stretch since the step's start, m
  };
  Offset offset(const Anchor& anchor, const State& state) const;
  /// Add gradient and Hessian of a function of e with gradient y (N, world axes) and stiffness K (N/m).
  void scatter_gradient(const Anchor& anchor, const Vector3& lever, const Vector3& y, VectorX& gradient) const;
  void scatter_hessian(const Anchor& anchor, const Vector3& lever, const Vector3& y, const Matrix3& stiffness,
                       BlockMatrix& hessian, Curvature curvature) const;

 private:
  struct Slot {
    const ShapeGeometry* geometry = nullptr;
    double friction = 0;
    std::uint32_t id = 0;
    ContactObject kind = ContactObject::fixed;
    bool seen = false;    // last_pose is valid
    Pose last_pose;       // at the end of the last step
    Pose start_pose;      // at the start of this step
    bool jumped = false;  // the caller moved the object between last_pose and start_pose
    Pose end_pose;        // at the end of this step, by its twist: exact if fixed, predicted if moving
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
  void begin_anchor(Anchor& anchor, const Vector3& start, const Vector3& end);
  const Pose& pose_before(const Anchor& anchor) const;
  bool sweep(Anchor& anchor, const Vector3& start, const Vector3& end, double limit);
  static bool same_side(const Pose& from, const Vector3& before, const Pose& to, const Vector3& now);
  static bool turns_far(const Pose& from, const Pose& to);
  static std::optional<Crossing> meeting(const Slot& slot, const Vector3& start, const Vector3& end);
  static bool only_turns_past(const ShapeGeometry& geometry, const Pose& from, const Pose& to, const Vector3& start,
                              const Vector3& end);
  void find_candidates(int slot, const State& state);
  template <typename Found>
  void find_crossed(const State& state, Found&& found);
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
  std::vector<std::int32_t> skin_index_;  // by node; -1: not a skin node
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
  double cleared_normal_ = 0, cleared_friction_ = 0;  // energy of the contacts removed since the last step, J
  std::uint64_t queries_ = 0;
};

/// U_n of all anchors. It also calls the set's begin_step and end_step.
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
  bool revise(const State& state) override { return contacts_.revise(state); }
  void end_step(State& state) override { contacts_.end_step(state); }
  EnergyFlow flow(double, double, double) const override { return contacts_.normal_flow(); }

 private:
  ContactSet& contacts_;
};

}  // namespace softhand
