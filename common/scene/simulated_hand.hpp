// One hand of a simulation: where it is in the state, its terms, and what only it has.
//
// Node n of the hand's model is node `first_node` + n of the state. Bone b is body `first_body` + b.
#pragma once

#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "energies/contact.hpp"
#include "energies/tissue.hpp"
#include "math/helper_thread.hpp"
#include "model/hand_model.hpp"
#include "model/state.hpp"
#include "scene/simulation_options.hpp"
#include "scene/untangle.hpp"

namespace softhand {

class BodyCoupling;
class Inertia;
class SkinContact;

class SimulatedHand {
 public:
  SimulatedHand(const HandModel& model, int first_node, int first_body, const SimulationOptions& options);

  const HandModel& model() const { return model_; }
  int first_node() const { return first_node_; }
  int first_body() const { return first_body_; }
  int body(Body bone) const { return first_body_ + index_of(bone); }
  /// The tissue in the numbering of the state. Nodes before the hand's are at the origin and belong to no tetrahedron.
  TissueModel placed_tissue() const;

  /// Makes the hand's terms and appends them to `terms`. `layout`: of the state with all hands and objects. Tissue
  /// terms exist only if the hand has tissue, and contact with objects only if there are slots. The slots are the last
  /// bodies of the state.
  void add_terms(const SimulationOptions& options, DofLayout layout, int mirrored_slots, int slots,
                 HelperThread* helper, std::vector<std::unique_ptr<Energy>>& terms);
  /// Gives the bones their masses, with `gravity` in m/s^2.
  void set_masses(Inertia& inertia, const Vector3& gravity) const;

  /// As `HandSimulation::reposition`.
  void reposition(State& state, const Pose& wrist);
  Pose joint_pose(const State& state, Joint joint) const;
  Twist joint_velocity(const State& state, Joint joint) const;
  /// Each node gets the velocity of its bone at the node, if this is slower.
  void limit_node_velocities(State& state) const;
  /// m, from a bone's joint to its target.
  double largest_coupling_stretch(const State& state) const;
  /// Carries out the check that is due after a step of `time_step` s. `tissue_energy` (J): of tissue and attachments.
  /// Returns the number of nodes that were put back.
  int untangle(State& state, double time_step, double tissue_energy, const Inertia& inertia);
  /// The quick check of a state from outside. Returns the same.
  int check_outside_state(State& state);

  // The terms. `add_terms` was called, and `terms` owns them.
  BodyCoupling& coupling() { return *coupling_; }
  const BodyCoupling& coupling() const { return *coupling_; }
  /// Contact with the objects in the slots. Null without slots.
  ContactSet* contacts() { return contacts_.get(); }
  const ContactSet* contacts() const { return contacts_.get(); }
  /// Contact of the skin with itself. Null: it is switched off.
  SkinContact* skin() { return skin_; }
  const SkinContact* skin() const { return skin_; }
  /// Null: the hand has only bones.
  const Tissue* tissue() const { return tissue_; }
  /// Tetrahedra that relax, and evaluations of all tetrahedra.
  int relaxing_elements() const { return relaxing_ == nullptr ? 0 : relaxing_->element_count(); }
  std::uint64_t evaluated_elements() const;
  /// Whether the term holds the tissue: tissue or attachments.
  bool is_tissue(const Energy* term) const { return std::ranges::find(holding_tissue_, term) != holding_tissue_.end(); }

  Untangler& untangler() { return untangler_; }
  const Untangler& untangler() const { return untangler_; }

 private:
  HandModel model_;
  int first_node_, first_body_;
  std::array<Pose, kJointCount> joint_in_body_{};  // by joint: its frame in its body's frame
  Untangler untangler_;
  BodyCoupling* coupling_ = nullptr;
  std::unique_ptr<ContactSet> contacts_;
  SkinContact* skin_ = nullptr;
  Tissue* tissue_ = nullptr;
  RelaxingTissue* relaxing_ = nullptr;
  std::vector<const Energy*> holding_tissue_;
};

/// Appends a hand's tissue that has the numbers of the state (`placed_tissue`).
void append_tissue(TissueModel& all, const TissueModel& placed);

}  // namespace softhand
