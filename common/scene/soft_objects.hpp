// The flexible objects of a scene (ES2725128A1 claim 8), as a part of the simulation of hands (docs/soft-objects.md).
//
// Their nodes are the last nodes of the state, one object after the other. They have the hands' tissue law. Contact has
// the hands' anchor law. They touch the skin of hands and each other (skin_contact.hpp, a term of the simulation), and
// the rigid objects in the slots (contact.hpp). All blocks between an object and a hand are loose blocks of the matrix.
// So the factor has the object's block beside the hand's, and its pattern never changes.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "contact/contact_report.hpp"
#include "energies/contact.hpp"
#include "energies/skin_contact.hpp"
#include "energies/tissue.hpp"
#include "messages/messages.hpp"
#include "model/object_model.hpp"
#include "model/soft_object.hpp"
#include "model/state.hpp"
#include "model/tissue_model.hpp"

namespace softhand {

class SoftObjects {
 public:
  /// `hands`: their nodes come first. The bodies have passed `validate_tetrahedra` (object_file.cpp checks). Throws
  /// std::invalid_argument for more than kMaxSoftObjects.
  SoftObjects(const TissueModel& hands, std::vector<SoftObject> objects);

  /// Id on the topics.
  static std::uint32_t id(int i) { return kFirstSoftObject + static_cast<std::uint32_t>(i); }

  int count() const { return static_cast<int>(objects_.size()); }
  const SoftObject& object(int i) const { return objects_[static_cast<std::size_t>(i)]; }
  /// First node of an object in the state; of `count()`: the number of all nodes of the state.
  int first_node(int i) const { return first_[static_cast<std::size_t>(i)]; }
  int node_count(int i) const { return first_node(i + 1) - first_node(i); }
  /// Boundary triangles of an object, by nodes of the state.
  std::span<const std::array<std::int32_t, 3>> surface(int i) const;
  /// Of the hands and of the objects, in the numbering of the state.
  const TissueModel& model() const { return all_; }
  /// Friction coefficients with skin, by object.
  std::vector<double> frictions() const;
  /// By node of the state, kg, with the hands'.
  const std::vector<double>& node_masses() const { return masses_; }
  double mass(int i) const;
  /// At the start of the scene, world. The hands' columns are zero.
  const Eigen::Matrix3Xd& start_positions() const { return start_; }
  /// A ball around all nodes of an object in `state`.
  struct Ball {
    Vector3 centre = Vector3::Zero();
    double radius = 0;
  };
  Ball ball(int i, const State& state) const;
  /// m/s, of any node of an object.
  double fastest(int i, const State& state) const;

  /// Makes the terms tissue and, if there are slots, contact with the objects in them. Appends them to `terms`.
  struct TermOptions {
    double contact_stiffness = 0;  ///< k_c, N/m^3
    int first_body = 0, mirrored_slots = 0, slots = 0;
    bool single_hessian = false;
    HelperThread* helper = nullptr;
  };
  void add_terms(const TermOptions& options, std::vector<std::unique_ptr<Energy>>& terms);

  /// Contact with the skin of hands and between the objects, a term of the simulation.
  void use(SkinContact& skin) { skin_ = &skin; }

  // The terms. `add_terms` and `use` were called.
  Tissue& tissue() { return *tissue_; }
  const Tissue& tissue() const { return *tissue_; }
  SkinContact& skin() { return *skin_; }
  const SkinContact& skin() const { return *skin_; }
  /// Contact with the objects in the slots. Null without slots.
  ContactSet* contacts() { return contacts_.get(); }
  const ContactSet* contacts() const { return contacts_.get(); }

  /// Whether any object touches something.
  bool touches() const { return !skin_->anchors().empty() || (contacts_ && contacts_->count() > 0); }
  /// Whether a hand touches the object.
  bool touches_hand(int i) const;
  /// Whether another flexible object touches the object.
  bool touches_soft_object(int i) const;
  /// Before a step. With `all`, the hands pass through every object. Without, they pass only through objects that they
  /// passed through before. The box around the nodes of such an object must still contain a node of a hand.
  void update_passing(const State& state, bool all);
  /// The hands pass through this many objects.
  int passing() const;

  /// After a step of `time_step` seconds. If steps end early while a hand presses hard, hand and object can get wound
  /// into each other. Part of the object then stays inverted, and no later step converges. At once such an object moves
  /// as a rigid body, because the velocities of its nodes do not predict their next movement. After 0.1 s it gets its
  /// rest shape where it is, but outside the objects in the slots, and its velocity is zero. Its contacts end, and the
  /// hands pass through it as after a reset. Returns the number of nodes that were put back; their contacts with skin
  /// must end, too. Adds no kinetic energy.
  ///
  /// A few tetrahedra can stay inverted in a minimum of the energy, also in steps that converge. After 0.1 s their
  /// nodes are placed by the nodes around them, if the tissue then has less energy. The contacts of these nodes with
  /// the objects in the slots end, all others persist. A call tries at most four clusters of such tetrahedra. Does not
  /// allocate. Not in the source.
  int untangle(State& state, double time_step, bool converged);
  /// All that a step carries to the next one, besides the terms.
  struct Memory {
    std::vector<double> tangled;   // s, by object: for how long it has been tangled
    std::vector<double> inverted;  // s, by object: for how long it has had inverted tetrahedra without being tangled
  };
  const Memory& save() const { return memory_; }
  /// No object has been tangled.
  void forget();
  /// Throws std::invalid_argument if there are other objects.
  void load(const Memory& memory);

  /// Force (N) of the hands and of other flexible objects on object `i` in the last step.
  Vector3 skin_force(int i) const;

  /// Adds the contacts between a hand and the objects at the end of the last step. Both sides have points, and each
  /// side bears half of the force. So each point counts half of its area. The place of object i is `first_place` + i.
  /// Nodes have the numbers of the state.
  void write_contacts(const State& state, int hand, int first_place, ContactReport& report, Contacts& out) const;
  /// Writes all but owner and stamp. Does not allocate.
  void write_state(int i, const State& state, SoftObjectState& out) const;

 private:
  bool overlaps_hands(int i, const State& state) const;
  Vector3 centre_of_mass(int i, const State& state) const;
  bool is_inverted(int i, const std::array<std::int32_t, 4>& corners, const State& state) const;
  int inverted_count(int i, const State& state) const;
  int unfold(int i, State& state);
  bool place_by_surroundings(int i, State& state) const;
  void stop_deformation(int i, State& state) const;
  void restore_shape(int i, State& state) const;

  std::vector<SoftObject> objects_;
  std::vector<int> first_;
  std::vector<std::size_t> first_triangle_;  // of `alone_.surface`, by object
  TissueModel all_;                          // of the hands and of the objects
  TissueModel alone_;                        // without the hands' tetrahedra, skin and contact points; with their nodes
  std::vector<double> masses_;
  Eigen::Matrix3Xd start_;
  Memory memory_;
  std::vector<std::uint8_t> moved_, around_, tried_;  // by node of the state, in `unfold`
  Eigen::Matrix3Xd before_;                           // positions, in `unfold`
  Tissue* tissue_ = nullptr;
  SkinContact* skin_ = nullptr;
  std::unique_ptr<ContactSet> contacts_;
};

}  // namespace softhand
