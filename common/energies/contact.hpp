// Contact of the skin with objects: the anchors (figure 4) and the normal energy U_n (ES2725128A1 eq. 32).
//
//   U_n = sum 1/2 k_c A min(0, u)^2,   u = n . e,   e = R^T (x_p - x_b) - a
//
// a and n are the anchor and its outward normal in the object's frame. (x_b, R) is the object's body. x_p is a contact
// point of the skin (contact/contact_point.hpp), and A is its area. Degrees of freedom: the nodes of the point, and the
// translation and rotation of the object's body if the object is movable. Units: J, m, m^2, N/m^3.
//
// This file joins the pieces in contact/: colliders, candidates, the anchor law and the report. ContactSet owns their
// memory.
//
// These are the departures from the source.
//
// In eq. 32 the normal n is fixed in the world. Here n rotates with the object, so the energy is invariant under a
// rigid motion of point and object. Then force and torque balance exactly: the opposite of the point's force acts on
// the object at the point's position.
//
// A contact is one-sided, so it only pushes, where u < 0. The exception is a point that is predicted to cross the
// surface within the step. Its anchor is put at the crossing at the step's start. It is two-sided until an iteration
// has moved the point. Otherwise the first iteration would miss the contact, because it starts before the crossing.
// Then a tip at 1 m/s would sink 11 mm.
//
// Contact is revised after iterations. A point that crossed a surface without being predicted to gets an anchor at the
// crossing. Then no anchor is two-sided any more.
//
// A point that starts inside is anchored at its own position. The anchor then moves out to the nearest surface point,
// at 0.75 m/s at most.
//
// The plane is frozen within a step. If an anchor slides over a curved surface, the plane is the one ahead, at the
// position that the point's velocity predicts. The plane behind would lift a point at 0.5 m/s off a finger-thick
// cylinder by (v dt)^2 / 2R = 0.8 mm, and the contact would chatter.
//
// A corner or needle of an object (ShapeGeometry::sharp_points) can pass between two contact points. If it enters the
// skin, it gets an anchor of its own. The contact point is then the place of the skin that it entered. The normal is
// that of the skin. The skin slides below the anchor.
//
// An anchor that slides moves to the nearest surface, but never to the far side of a thin wall.
//
// A fixed object moves within the step by its velocity. The energy uses the pose at the step's end, because it is a
// function of the positions at the step's end. Paths and the friction bound use the pose at the step's start. So only
// relative motion counts.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "contact/anchor_law.hpp"
#include "contact/candidates.hpp"
#include "contact/collider.hpp"
#include "contact/contact_point.hpp"
#include "contact/contact_report.hpp"
#include "energies/memory.hpp"
#include "messages/messages.hpp"
#include "model/tissue_model.hpp"

namespace softhand {

/// The touched points of one hand. Creates, slides and ends anchors. `ContactEnergy` calls begin_step and end_step.
/// `FrictionEnergy` only reads the set, and must come after `ContactEnergy` in the list of terms. After the terms are
/// bound, nothing allocates.
class ContactSet {
 public:
  /// A sharp point is as stiff as a contact point with this area, m^2: 3 N press it in by 0.5 mm with the default k_c.
  static constexpr double sharp_area = 6.7e-6;
  /// Largest gap of a NearContact, m: the way of a fast hand (0.5 m/s) in the age of a force and one period.
  static constexpr double near_gap = 0.015;
  using Anchor = ContactAnchor;
  using Offset = AnchorOffset;

  /// Objects are the bodies `first_body` ... `first_body + slots - 1` of the state. The first `moving_slots` of them
  /// may be movable. `stiffness` is k_c, N/m^3: a force per area and depth. `node_masses` (kg) are used only to
  /// estimate the normal force of a fresh contact. Throws std::invalid_argument if k_c is not finite and > 0.
  ContactSet(const TissueModel& hand, const std::vector<double>& node_masses, double stiffness, int first_body,
             int moving_slots, int slots);
  /// The same for given contact points, in a state with `node_count` nodes.
  ContactSet(ContactPoints points, int node_count, double stiffness, int first_body, int moving_slots, int slots);
  ContactSet(const ContactSet&) = delete;
  ContactSet& operator=(const ContactSet&) = delete;

  const ContactPoints& points() const { return points_; }

  /// Puts an object into a slot, or changes its friction. Contacts persist if shape and id are the same. `geometry`
  /// must outlive its time in the slot. `friction` is Coulomb's mu, >= 0.
  void set_object(int slot, const ShapeGeometry* geometry, double friction, std::uint32_t id, ContactObject kind);
  /// Removes the object and ends its contacts.
  void clear_object(int slot);
  /// Call this after the hand was teleported. All contacts end, and no path starts at the old positions.
  void reset();

  /// All that a step carries to the next one. The shapes are not part of it.
  struct Memory {
    struct Slot {
      bool is_set = false;
      std::uint32_t id = 0;
      double friction = 0;
      Collider::Memory collider;
      Wrench wrench;  // on the object in the last step
      int count = 0;
    };
    std::vector<AnchorMemory> anchors;  // in the order in which they began
    std::vector<Slot> slots;
    double dissipated = 0, cleared_normal = 0, cleared_friction = 0;  // J
  };
  const Memory& save() const;
  /// The slots must have the same objects as when the memory was saved. Throws std::invalid_argument otherwise.
  void load(const Memory& memory);

  // For nodes that are teleported. `nodes`: by node, 1 for the nodes concerned. `bones`: by node, a point of its bone,
  // world. A contact point is concerned if one of its nodes is.
  /// Marks in `hooked` (by node) the nodes that a contact pushes straight away from their bones: they are on the far
  /// side of the object.
  void mark_hooked(const State& state, const Eigen::Matrix3Xd& bones, std::span<std::uint8_t> hooked) const;
  /// The end of a skin node's path from its bone to `to`: the first surface that it meets, otherwise `to`. For inner
  /// nodes always `to`.
  Vector3 stopped(const State& state, std::int32_t node, const Vector3& bone, const Vector3& to) const;
  /// Prepares `may_touch` for the next step of `time_step` s. Call between steps.
  void look_ahead(const State& state, double time_step);
  /// Whether a node may reach the object in the next step, if its velocity relative to the object at most doubles. Call
  /// after `look_ahead`, with the object's pose and velocity for the next step in `state`.
  bool may_touch(int slot, const State& state);
  /// Energy of the nodes in U_n and U_f at the end of the last step, J.
  double stored_energy(std::span<const std::uint8_t> nodes) const;
  /// Energy that the nodes would have at their positions in `state`, J. Contacts that do not hook persist, and points
  /// inside an object are pushed out. Infinite if a point's bone is inside an object.
  double stored_energy_at(const State& state, std::span<const std::uint8_t> nodes, const Eigen::Matrix3Xd& bones) const;
  /// Ends the contacts of the nodes. No path starts at the old positions: the next step uses the positions at its
  /// start.
  void release(std::span<const std::uint8_t> nodes);

  /// A step that began and did not end (refused or failed) has no effect on the next step.
  void begin_step(const State& state, double time_step);
  /// Ends a step that failed: everything is as before `begin_step`.
  void cancel_step();
  /// `Energy::revise`: adds the points that crossed a surface between the step's start and `state`. Fresh anchors that
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
  /// Quantile `fraction` (0 to 1; 1: the largest) of the penetrations in `state`, metres. 0 without contact.
  double penetration_quantile(const State& state, double fraction);
  /// Heat of sliding since construction, J.
  double dissipated() const { return dissipated_; }
  /// Energy flows of U_n and U_f in the last step. The energy of U_n counts only while a contact pushes.
  const EnergyFlow& normal_flow() const { return normal_flow_; }
  const EnergyFlow& friction_flow() const { return friction_flow_; }
  /// Number of searches for a contact point since construction: closest points and crossings.
  std::uint64_t queries() const { return queries_ + candidates_.queries(); }
  /// Number of anchors since construction that were dropped because the list was full.
  std::uint64_t dropped() const { return dropped_; }
  /// Adds the contacts at the end of the last step. The place of an object is its slot.
  void write(const State& state, ContactReport& report, Contacts& out) const;
  /// Writes the nearest object of each bone that touches nothing, up to `near_gap`. `out` has the contacts.
  void write_near(const State& state, Contacts& out) const;

  /// Of the anchor's contact point, world.
  Vector3 position(const Anchor& anchor, const State& state) const {
    return points_.at(anchor.point, state.node_positions);
  }
  Offset offset(const Anchor& anchor, const State& state) const {
    return anchor_law::offset(anchor, at(anchor.slot).collider.pose(state), position(anchor, state));
  }
  /// Add gradient and Hessian of a function of e with gradient y (N, world axes) and stiffness K (N/m).
  void scatter_gradient(const Anchor& anchor, const Vector3& lever, const Vector3& y, VectorX& gradient) const {
    at(anchor.slot).collider.scatter_gradient(blocks_, anchor.point, lever, y, gradient);
  }
  void scatter_hessian(const Anchor& anchor, const Vector3& lever, const Vector3& y, const Matrix3& stiffness,
                       BlockMatrix& hessian, Curvature curvature) const {
    at(anchor.slot)
        .collider.scatter_hessian(points_, blocks_, anchor.point, lever, y, stiffness, curvature == Curvature::exact,
                                  hessian);
  }

 private:
  struct Slot {
    explicit Slot(Collider from) : collider(std::move(from)) {}
    Collider collider;
    double friction = 0;
    std::uint32_t id = 0;
    Wrench wrench;
    int count = 0;
  };

  Slot& at(int slot) { return slots_[static_cast<std::size_t>(slot)]; }
  const Slot& at(int slot) const { return slots_[static_cast<std::size_t>(slot)]; }
  std::uint8_t& has_anchor(int slot, int point) {
    return has_anchor_[static_cast<std::size_t>(slot) * static_cast<std::size_t>(points_.size()) +
                       static_cast<std::size_t>(point)];
  }
  void mark_anchors();
  double stiffness_of(int point) const {
    return stiffness_ * (point < points_.count() ? points_[point].area : sharp_area);
  }
  bool is_taken(int triangle_point) const;
  bool has_left(const Anchor& anchor, const State& state);
  bool has_entered(int slot, int sharp) const;
  Anchor* create(int slot, const ContactCandidate& candidate);
  template <typename Ends>
  void remove_if(Ends&& ends);
  const Pose& pose_before(const Anchor& anchor) const;
  void begin_anchor(Anchor& anchor, const Vector3& start, const Vector3& end);
  bool sweep(Anchor& anchor, const AnchorPath& path, double limit);
  template <typename Found>
  void find_crossed(const State& state, Found&& found);
  void slide(Anchor& anchor, double drag, const State& state);
  void slide_on_skin(Anchor& anchor, const Vector3& movement, const State& state);
  bool hooks(const Anchor& anchor, const State& state, const Eigen::Matrix3Xd& bones) const;
  bool clear(const Anchor& anchor);
  void account(Anchor& anchor, const Offset& end, const Vector3& push, const Vector3& drag, const State& state);
  void settle(Anchor& anchor, const Offset& offset);

  double stiffness_;
  int moving_slots_;
  ContactPoints points_;
  PointBlocks blocks_;
  Candidates candidates_;
  std::vector<double> depths_;  // of `penetration_quantile`
  std::vector<Slot> slots_;
  std::vector<Anchor> anchors_;
  std::vector<std::uint8_t> has_anchor_;  // by (slot, point)
  double time_step_ = 0;
  double dissipated_ = 0;
  double cleared_normal_ = 0, cleared_friction_ = 0;  // energy of the contacts removed since the last step, J
  // For `cancel_step`: as before the step.
  bool in_step_ = false;
  std::vector<Anchor> anchors_before_;
  double cleared_normal_before_ = 0, cleared_friction_before_ = 0;
  mutable Memory saved_;
  EnergyFlow normal_flow_, friction_flow_;
  std::uint64_t dropped_ = 0;
  std::uint64_t queries_ = 0;
};

/// U_n of all anchors. It also calls the set's begin_step and end_step.
class ContactEnergy final : public EnergyWithMemory<ContactEnergy> {
 public:
  /// `name`: of the term, a literal.
  explicit ContactEnergy(ContactSet& contacts, std::string_view name = "contact") : contacts_(contacts), name_(name) {}
  std::string_view name() const override { return name_; }
  bool has_kinks() const override { return true; }
  void add_pattern(BlockPattern& pattern) const override { contacts_.add_pattern(pattern); }
  void bind(const BlockMatrix& matrix) override { contacts_.bind(matrix); }
  void begin_step(const State& state, double time_step) override { contacts_.begin_step(state, time_step); }
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  bool revise(const State& state) override { return contacts_.revise(state); }
  void end_step(State& state) override { contacts_.end_step(state); }
  void cancel_step() override { contacts_.cancel_step(); }
  using Memory = ContactSet::Memory;
  const Memory& save() const { return contacts_.save(); }
  void load(const Memory& memory) { contacts_.load(memory); }
  void reset() { contacts_.reset(); }
  EnergyFlow flow(double, double, double) const override { return contacts_.normal_flow(); }

 private:
  ContactSet& contacts_;
  std::string_view name_;
};

}  // namespace softhand
