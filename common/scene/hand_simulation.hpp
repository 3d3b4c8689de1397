// One or two simulated hands with the objects that they can touch. Only this file, simulated_hand.cpp and
// soft_objects.cpp name the energy terms.
//
// Nodes of the state: first those of the hands, hand by hand, then those of the flexible objects (soft_objects.hpp).
//
// Bodies of the state: first the 21 bones of each hand, then `mirrored_slots` objects that may move, then
// `static_slots` objects that may not move. A slot is empty, kinematic or dynamic. The motion of a kinematic object is
// prescribed, and no force changes it. A dynamic object is a twin with mass, inertia and gravity.
//
// Two hands touch each other, and the objects, in one implicit system. All blocks between hands are loose blocks of the
// matrix. So the factor has the block of one hand beside that of the other (docs/two-hands.md).
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "energies/energy.hpp"
#include "geometry/shape.hpp"
#include "messages/messages.hpp"
#include "messages/plain_bytes.hpp"
#include "model/hand_model.hpp"
#include "model/joint_law.hpp"
#include "scene/simulated_hand.hpp"
#include "scene/simulation_options.hpp"
#include "scene/soft_objects.hpp"
#include "scene/step_guess.hpp"
#include "solver/newton_solver.hpp"

namespace softhand {

class BodyCoupling;
class SkeletonContact;
class ContactSet;
class Inertia;
class ObjectJointEnergy;
class OtherHands;
class NodeCoupling;
class PlaneContact;
class SkinContact;
class SkinTractionReport;

enum class SlotMode : std::uint8_t { empty, kinematic, dynamic };

/// Data of an object that the simulation mirrors.
struct MirroredObject {
  std::uint32_t id = 0;
  const ShapeGeometry* shape = nullptr;   ///< must outlive its time in the slot
  double mass = 1;                        ///< kg, > 0
  Matrix3 inertia = Matrix3::Identity();  ///< kg m^2, body axes
  double friction = 0;
};

/// A joint between two mirrored objects, or between one and an object that does not move.
struct MirroredJoint {
  JointLaw law;
  int parent_slot = -1;  ///< -1: the parent does not move
  Pose parent_pose;      ///< of the parent's body frame in the world, used if `parent_slot` is -1
  int child_slot = 0;
  Pose parent_from_joint;  ///< the joint's frame in the parent's body frame
  Pose child_from_joint;
};

/// Counts of computations since construction. A count is exactly 0 if the scene does not have that part.
struct WorkCounters {
  std::uint64_t tissue_elements = 0;    ///< evaluations of a tetrahedron of a hand
  std::uint64_t relaxing_elements = 0;  ///< tetrahedra of hands that relax
  std::uint64_t soft_elements = 0;      ///< evaluations of a tetrahedron of a flexible object
  std::uint64_t contact_queries = 0;    ///< searches for the point where a node meets an object
  std::uint64_t dropped_contacts = 0;   ///< new contacts for which the list had no room, so that points pass through
  std::uint64_t skin_part_queries = 0;  ///< tests whether two parts of the skin are near each other
  std::uint64_t skin_queries = 0;       ///< searches for the place where a point of the skin meets the skin
  std::uint64_t factorised_steps = 0;   ///< steps that factorised a matrix
  std::uint64_t patches_used = 0;       ///< contacts of other hands, summed over steps
};

class HandSimulation {
 public:
  /// The hand is at rest with its wrist at the world's origin. All slots are empty. `soft_objects` are at rest at their
  /// poses. Throws std::invalid_argument for a flexible object that cannot be simulated.
  HandSimulation(const HandModel& hand, const SimulationOptions& options, int mirrored_slots, int static_slots,
                 const ObjectSpring& object_spring = {}, int object_joints = 0,
                 std::vector<SoftObject> soft_objects = {});
  /// The same for one or two hands. Each is at rest with its wrist at the world's origin: `reposition` them before the
  /// first step. Functions that have a number `hand` are about one of them. Two hands cannot share an object with hands
  /// of other processes: throws std::invalid_argument with the option `other_hands`.
  HandSimulation(const std::vector<HandModel>& hands, const SimulationOptions& options, int mirrored_slots,
                 int static_slots, const ObjectSpring& object_spring = {}, int object_joints = 0,
                 std::vector<SoftObject> soft_objects = {});
  ~HandSimulation();

  int hand_count() const { return static_cast<int>(hands_.size()); }
  const HandModel& hand(int hand = 0) const { return at(hand).model(); }
  /// First node and first bone of a hand in the state.
  int first_node(int hand) const { return at(hand).first_node(); }
  int first_body(int hand) const { return at(hand).first_body(); }
  const State& state() const { return state_; }
  int slot_count() const { return mirrored_slots_ + static_slots_; }
  bool slot_is_static(int slot) const { return slot >= mirrored_slots_; }

  /// Moves the whole hand rigidly, so that the pose of its wrist joint is `wrist`. Its velocities become zero, and its
  /// contacts with the objects in the slots end. All contacts between hands end, and all contacts of flexible objects
  /// with hands and each other. The hand's contact with its own skin stays, because it moves with the hand. Contacts of
  /// flexible objects with the objects in the slots stay too.
  void reposition(const Pose& wrist, int hand = 0);
  /// Continues from another state of the same layout, for example a stored one. Contacts end and the energy ledger
  /// restarts. Throws std::invalid_argument if the layout differs.
  void restore(const State& state);

  /// Target of eq. 18 for one bone: its joint frame in the world, and the velocity of that frame's origin. It is valid
  /// until changed. `strength`: part of the gains and caps of the hand file, > 0 and at most 1.
  void set_target(Body body, const Pose& joint, const Twist& velocity, double strength = 1, int hand = 0);
  /// Clears the targets of all bones of all hands. A bone is not pulled until it has a target again.
  void clear_targets();

  void set_slot(int slot, const MirroredObject& object);
  void clear_slot(int slot);
  SlotMode slot_mode(int slot) const { return modes_[static_cast<std::size_t>(slot)]; }
  /// Sets the pose at the start of the next step and the velocity in that step. Call it for a kinematic slot, or when a
  /// slot changes its mode. A kinematic slot moves with this velocity until the next call.
  void set_slot_motion(int slot, const Pose& pose, const Twist& velocity);
  void make_kinematic(int slot);
  void make_dynamic(int slot, const Vector3& gravity);
  Pose slot_pose(int slot) const { return state_.body_poses[static_cast<std::size_t>(slot_body(slot))]; }
  Twist slot_velocity(int slot) const { return state_.body_velocities[static_cast<std::size_t>(slot_body(slot))]; }
  /// Planes that stop a dynamic slot in the world (mode owner).
  void set_planes(int slot, std::span<const NeighbourPlane> planes);
  // Contacts of other hands with an object in a dynamic slot (mode owner, energies/other_hands.hpp). They act in the
  // next step only.
  void clear_other_hands();
  /// As `OtherHands::add`.
  void add_other_hand(int slot, const ContactPatch& patch, const Pose& object, double age);
  /// Target of U'_crb, the world's copy (mode symmetric).
  void set_object_target(int slot, const Pose& pose, const Twist& velocity);

  /// Places 0 ... `object_joints` - 1 for joints. A joint acts from the next step on. Its slots must be dynamic: the
  /// slots of one set of jointed objects become dynamic together.
  int joint_count() const;
  void set_joint(int place, const MirroredJoint& joint);
  void clear_joint(int place);
  /// Coordinate of the joint in rad or m, and the distance (m) of its frames in the directions that it holds.
  double joint_coordinate(int place) const;
  double joint_gap(int place) const;

  /// Copies the whole state of `other`, including contacts: both then continue alike. `other` must have the same hands
  /// and the same number of slots. The shapes in its slots must outlive this object.
  void take_state(const HandSimulation& other);

  // A saved state (docs/flight-recorder.md). A simulation of the same hands and options can load it. It continues with
  // the same bits as the one that saved it, if that one calls `forget` when it saves.
  /// Writes the state and the memories of all terms and of the untanglers. Does not allocate.
  void save(ByteWriter& out) const;
  /// The caller has put the objects into their slots and the joints into their places, as they were. Throws
  /// std::runtime_error if the bytes do not fit. Then part of them may have been loaded.
  void load(ByteReader& in);
  /// Drops all that a step only reuses: the factor, gradients, the energies at the start. The next step is an ordinary
  /// one. Does not allocate.
  void forget();
  /// Calls visit(name, value) for all parts of the state after a step.
  template <typename Visit>
  void for_each_part(Visit&& visit) const {
    visit("node_positions", state_.node_positions);
    visit("node_velocities", state_.node_velocities);
    visit("body_poses", state_.body_poses);
    visit("body_velocities", state_.body_velocities);
    visit("bone_contact_forces", bone_contact_forces_);
    visit("ledger", ledger_);
  }

  /// As `NewtonSolver::set_work_budget`.
  void set_work_budget(double work_budget) { solver_->set_work_budget(work_budget); }
  StepReport step(double time_step);
  /// Whether steps are entered into the energy ledger from now on (off at first). Switching it on restarts the ledger.
  void enable_ledger(bool enable);

  // Results of the last step.
  Pose joint_pose(Joint joint, int hand = 0) const;
  Twist joint_velocity(Joint joint, int hand = 0) const;
  /// Velocity (world) that the point at `place` has if it moves rigidly with the carpus. The noise of a hand at rest is
  /// removed. 0 without the option `other_hands`.
  Twist carrying_velocity(const Vector3& place) const;
  /// Force and torque of the coupling on the bone, N and N m, about its joint's origin.
  Wrench coupling_wrench(Body body, int hand = 0) const;
  /// Wrench of the hands and of flexible objects on the object in the slot, about the object's centre of mass.
  Wrench contact_wrench(int slot) const;
  Wrench object_coupling_wrench(int slot) const;
  /// Wrench of the other hands on the object in the slot in the last step, about its centre of mass.
  Wrench other_hands_wrench(int slot) const;
  /// Wrench of all joints on the object in the slot in the last step, about its centre of mass.
  Wrench joint_wrench(int slot) const;
  /// Prepares `may_touch` for the next step of `time_step` seconds.
  void look_ahead(double time_step);
  /// Whether any node may touch the object in the next step (`ContactSet::may_touch`).
  bool may_touch(int slot);
  /// Whether any node of a hand or of a flexible object touched the object in the last step.
  bool touched(int slot) const;
  /// Contacts with the objects in the slots and with flexible objects.
  void write_contacts(Contacts& out, int hand = 0) const;
  /// Puts a flexible object back to where it started, at rest. Its contacts end, and with them those of the other
  /// flexible objects and those between hands. If a hand is there, the hands pass through it until they have left the
  /// box around the object.
  void restart_soft_object(int object);
  /// Puts the nodes of a flexible object where `state` has them after `ahead` seconds, with its velocities. The counts
  /// of nodes must be equal.
  void place_soft_object(int object, const SoftObjectState& state, double ahead);
  /// Mode symmetric: a spring pulls each node of a shared flexible object towards where `state` has it, in the next
  /// steps.
  void pull_soft_object(int object, const SoftObjectState& state);
  /// Without that spring.
  void let_go_soft_object(int object);
  /// Whether flexible objects have tissue and weight. Without, their nodes go straight on, and a step costs hardly more
  /// than one without these objects.
  void simulate_soft_objects(bool on);
  bool simulates_soft_objects() const { return simulates_soft_; }
  /// While `on`, the hands pass through each other and through all flexible objects. Afterwards they still pass through
  /// those objects that they are in, until they have left them.
  void pass_through(bool on) { passes_through_ = on; }
  /// As in contact_patches.hpp, of the object in the slot.
  void write_patches(int slot, BoundedVector<ContactPatch, kMaxPatches>& patches) const;
  /// Writes the traction of the contacts on the hand's skin: with objects, flexible objects, the skin itself and
  /// another hand. Does not write key and stamp. `time_step`: s since the last message. `report`: of this hand.
  void write_traction(double time_step, SkinTractionReport& report, SkinTraction& out, int hand = 0) const;
  /// The flexible objects. Null: there are none.
  const SoftObjects* soft() const { return soft_.get(); }
  /// Contact of the skin with itself. Null: it is switched off.
  const SkinContact* skin(int hand = 0) const { return at(hand).skin(); }
  /// Contact between the hands, and of flexible objects. Null: there is one hand and no flexible object.
  const SkinContact* skin_between() const { return between_; }
  /// Sum of contact forces on the tissue around each bone, N. Includes those of the skin on itself, of another hand and
  /// of flexible objects.
  std::span<const Vector3, kBodyCount> bone_contact_forces(int hand = 0) const {
    return std::span(bone_contact_forces_).subspan(static_cast<std::size_t>(first_body(hand))).first<kBodyCount>();
  }
  /// Kinetic energy of nodes and moving bodies, J.
  double kinetic_energy() const;
  int inverted_elements() const;
  /// Number of tangled nodes of all hands that were put back since construction (untangle.hpp).
  std::uint64_t untangled_nodes() const { return untangled_nodes_; }
  int contact_count() const;       ///< points that touch the objects in the slots
  int skin_contact_count() const;  ///< points of skin that touch skin, of one hand or two, or flexible objects
  const EnergyLedger& ledger() const { return ledger_; }
  /// Calls f(name, joules) for each term, with its stored energy when a step was last entered into the ledger.
  template <typename F>
  void for_each_stored(F&& f) const {
    for (std::size_t t = 0; t < terms_.size(); ++t) f(terms_[t]->name(), stored_[t]);
  }
  WorkCounters work() const;
  /// Matrix of the last new linearisation in a step, for measurements. Hands and flexible objects are its core, the
  /// slots are its border.
  const BlockMatrix& hessian() const { return solver_->hessian(); }
  double deepest_penetration() const;       ///< m; 0 without contact
  double largest_coupling_stretch() const;  ///< m, from a bone's joint to its target, of all hands

 private:
  void read_soft_state(int object, const SoftObjectState& state, double ahead);
  template <typename Self, typename Visit>
  static void visit_own(Self& self, Visit&& visit);
  SimulatedHand& at(int hand) { return *hands_[static_cast<std::size_t>(hand)]; }
  const SimulatedHand& at(int hand) const { return *hands_[static_cast<std::size_t>(hand)]; }
  int slot_body(int slot) const { return hand_count() * kBodyCount + slot; }
  /// Contact of the hands and of flexible objects with the objects in the slots.
  template <typename Visit>
  void for_each_contacts(Visit&& visit) const {
    for (const auto& hand : hands_)
      if (hand->contacts() != nullptr) visit(*hand->contacts());
    if (soft_ && soft_->contacts() != nullptr) visit(*soft_->contacts());
  }
  /// Contact of each hand's skin with itself, and between hands and flexible objects.
  template <typename Visit>
  void for_each_skin(Visit&& visit) const {
    for (const auto& hand : hands_)
      if (hand->skin() != nullptr) visit(*hand->skin());
    if (between_ != nullptr) visit(*between_);
  }
  bool prepare(Linkage& linkage) const;
  bool guess(const Linkage& linkage, double time_step, State& state);
  bool has_joint(int slot) const;
  void set_contact_object(int slot);
  void take_objects(const HandSimulation& other);
  void collect_bone_contacts();
  void enter_step(const StepReport& report);
  void untangle(const StepReport& report, double time_step);

  std::vector<std::unique_ptr<SimulatedHand>> hands_;
  std::vector<std::int32_t> node_bones_;  // by node, the body of the nearest bone; -1: of a flexible object
  mutable ContactReport report_;          // scratch of `write_contacts`
  std::unique_ptr<SoftObjects> soft_;     // null: there are none
  bool simulates_soft_ = true;
  std::vector<NodeCoupling*> soft_couplings_;          // of shared flexible objects in mode symmetric, otherwise null
  Eigen::Matrix3Xd soft_positions_, soft_velocities_;  // scratch
  bool passes_through_ = false;
  ObjectSpring object_spring_;
  int mirrored_slots_;
  int static_slots_;
  State state_;
  std::unique_ptr<HelperThread> helper_;  // null: one thread
  std::vector<SlotMode> modes_;
  std::vector<MirroredObject> objects_;
  std::vector<std::unique_ptr<Energy>> terms_;
  // The terms that the simulation calls directly. `terms_` owns them.
  Inertia* inertia_ = nullptr;
  BodyCoupling* object_coupling_ = nullptr;
  SkinContact* between_ = nullptr;  // as `skin_between`
  SkeletonContact* skeleton_contact_ = nullptr;
  PlaneContact* planes_ = nullptr;
  OtherHands* other_hands_ = nullptr;    // null: only these hands touch objects, or mode symmetric
  ObjectJointEnergy* joints_ = nullptr;  // null: no joints between objects
  std::uint64_t factorised_steps_ = 0;
  bool restored_ = false;  // `restore` was called since the last step
  std::uint64_t untangled_nodes_ = 0;
  bool untangled_ = false;  // nodes were put back after the last step
  std::unique_ptr<NewtonSolver> solver_;
  StepGuess guess_;
  std::vector<Vector3> bone_contact_forces_;  // by bone of all hands
  Twist carpus_velocity_;                     // without the noise of rest; 0 without other hands
  bool ledger_enabled_ = false;
  EnergyLedger ledger_;
  std::array<double, kMaxTerms> stored_{};  // J, by term, after the last step that was entered into the ledger
  bool stored_is_valid_ = false;            // stored_ is valid: since then only steps moved tissue or bones
};

}  // namespace softhand
