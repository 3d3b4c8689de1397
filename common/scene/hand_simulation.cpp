#include "scene/hand_simulation.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "energies/body_coupling.hpp"
#include "energies/contact.hpp"
#include "energies/inertia.hpp"
#include "energies/joint.hpp"
#include "energies/node_coupling.hpp"
#include "energies/object_joint.hpp"
#include "energies/other_hands.hpp"
#include "energies/plane_contact.hpp"
#include "energies/skeleton_contact.hpp"
#include "energies/skin_contact.hpp"
#include "energies/tissue.hpp"
#include "math/low_pass.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kStandardGravity = 9.81;  // m/s^2
constexpr std::size_t kCarpus = index_of(Body::carpus);

Twist at_point(const Twist& of_centre, const Vector3& lever) {
  return {of_centre.linear + of_centre.angular.cross(lever), of_centre.angular};
}

// Removes the noise of a hand at rest from the velocity of its carpus, and follows a fast hand. This is the One Euro
// filter (Casiez, Roussel and Vogel, CHI 2012) with one cutoff for all components. A tracker with a noise of 0.1 mm and
// 1 mrad at 90 Hz makes about 10 mm/s.
void follow_carpus(const Twist& carpus, double time_step, Twist& smoothed) {
  constexpr double kCutoffAtRest = 1;     // Hz
  constexpr double kCutoffOfSpeed = 100;  // Hz per m/s
  constexpr double kLever = 0.1;          // m, from the carpus to the fingers
  const double speed = smoothed.linear.norm() + kLever * smoothed.angular.norm();
  const double gain = low_pass_gain(kCutoffAtRest + kCutoffOfSpeed * speed, time_step);
  smoothed.linear += gain * (carpus.linear - smoothed.linear);
  smoothed.angular += gain * (carpus.angular - smoothed.angular);
}

}  // namespace

HandSimulation::HandSimulation(const HandModel& hand, const SimulationOptions& options, int mirrored_slots,
                               int static_slots, const ObjectSpring& object_spring, int object_joints,
                               std::vector<SoftObject> soft_objects)
    : HandSimulation(std::vector{hand}, options, mirrored_slots, static_slots, object_spring, object_joints,
                     std::move(soft_objects)) {}

HandSimulation::HandSimulation(const std::vector<HandModel>& hands, const SimulationOptions& options,
                               int mirrored_slots, int static_slots, const ObjectSpring& object_spring,
                               int object_joints, std::vector<SoftObject> soft_objects)
    : report_(mirrored_slots + static_slots + static_cast<int>(kMaxSoftObjects)),
      object_spring_(object_spring),
      mirrored_slots_(mirrored_slots),
      static_slots_(static_slots) {
  if (hands.empty() || hands.size() > kMostHands)
    throw std::invalid_argument(std::to_string(hands.size()) + " hands, expected 1 to " + std::to_string(kMostHands));
  if (options.other_hands && hands.size() > 1)
    throw std::invalid_argument("the hands of one process cannot share objects with hands of other processes");
  TissueModel tissue;  // of all hands
  for (const HandModel& hand : hands) {
    hands_.push_back(std::make_unique<SimulatedHand>(hand, tissue.node_count(), hand_count() * kBodyCount, options));
    append_tissue(tissue, hands_.back()->placed_tissue());
  }
  const int hand_nodes = tissue.node_count(), bones = hand_count() * kBodyCount, bodies = bones + slot_count();
  bone_contact_forces_.assign(static_cast<std::size_t>(bones), Vector3::Zero());
  if (!soft_objects.empty()) soft_ = std::make_unique<SoftObjects>(tissue, std::move(soft_objects));
  state_.node_positions = soft_ ? soft_->start_positions() : Eigen::Matrix3Xd(3, hand_nodes);
  for (int n = 0; n < hand_nodes; ++n) state_.node_positions.col(n) = tissue.nodes[static_cast<std::size_t>(n)];
  state_.node_velocities.setZero(3, state_.node_positions.cols());
  state_.body_poses.resize(static_cast<std::size_t>(bodies));
  state_.body_velocities.resize(static_cast<std::size_t>(bodies));
  for (const auto& hand : hands_) {
    for (int b = 0; b < kBodyCount; ++b) {
      const Body bone = static_cast<Body>(b);
      state_.body_poses[static_cast<std::size_t>(hand->body(bone))] = hand->model().body_rest_pose(bone);
    }
  }
  modes_.assign(static_cast<std::size_t>(slot_count()), SlotMode::empty);
  objects_.resize(static_cast<std::size_t>(slot_count()));

  DofLayout layout = state_.layout();
  layout.border_bodies = slot_count();
  const std::vector<double> masses = soft_ ? soft_->node_masses() : lumped_masses(tissue);
  const Vector3 weight = options.gravity ? Vector3(0, -kStandardGravity, 0) : Vector3(Vector3::Zero());

  auto inertia = std::make_unique<Inertia>(masses, bodies);
  inertia_ = inertia.get();
  inertia->set_node_gravity(weight);
  for (int i = 0; soft_ && i < soft_->count(); ++i) {
    for (int n = soft_->first_node(i); n < soft_->first_node(i + 1); ++n)
      inertia->set_node_gravity(n, soft_->object(i).gravity);
  }
  for (const auto& hand : hands_) hand->set_masses(*inertia, weight);
  terms_.push_back(std::move(inertia));

  if (options.threads > 1) helper_ = std::make_unique<HelperThread>();
  for (const auto& hand : hands_)
    hand->add_terms(options, layout, mirrored_slots_, slot_count(), helper_.get(), terms_);
  if (soft_) {
    soft_->add_terms({.contact_stiffness = options.contact_stiffness,
                      .first_body = bones,
                      .mirrored_slots = mirrored_slots_,
                      .slots = slot_count(),
                      .single_hessian = options.solver.factor == "float" && options.solver.curvature != "exact",
                      .helper = helper_.get()},
                     terms_);
  }
  for (int i = 0; soft_ && i < soft_->count(); ++i) {
    soft_positions_.resize(3, std::max<Eigen::Index>(soft_positions_.cols(), soft_->node_count(i)));
    soft_velocities_.resize(3, soft_positions_.cols());
    soft_couplings_.push_back(nullptr);
    if (!soft_->object(i).is_shared || object_spring.linear_stiffness == 0) continue;
    // In mode symmetric gravity acts in the world alone.
    for (int n = soft_->first_node(i); n < soft_->first_node(i + 1); ++n)
      inertia_->set_node_gravity(n, Vector3::Zero());
    const auto first = masses.begin() + soft_->first_node(i);
    auto coupling =
        std::make_unique<NodeCoupling>(soft_->first_node(i), std::vector(first, first + soft_->node_count(i)),
                                       object_spring.linear_stiffness, object_spring.damping_ratio);
    soft_couplings_.back() = coupling.get();
    terms_.push_back(std::move(coupling));
  }
  if (soft_ || hand_count() > 1) {
    auto between = std::make_unique<SkinContact>(soft_ ? soft_->model() : tissue, masses, options.contact_stiffness,
                                                 options.skin_friction,
                                                 soft_ ? soft_->frictions() : std::vector<double>{}, "skin_between");
    between_ = between.get();
    if (soft_) soft_->use(*between_);
    terms_.push_back(std::move(between));
  }
  if (options.skin_contact || hand_count() > 1) {
    std::vector<std::vector<BoneCapsule>> capsules;
    for (const auto& hand : hands_) capsules.push_back(bone_capsules(hand->model(), hand->first_body()));
    auto skeleton_contact = std::make_unique<SkeletonContact>(capsules, options.skin_contact, layout);
    skeleton_contact_ = skeleton_contact.get();
    terms_.push_back(std::move(skeleton_contact));
  }
  if (mirrored_slots_ > 0 && object_spring.linear_stiffness == 0) {
    auto planes = std::make_unique<PlaneContact>(layout, bones, mirrored_slots_);
    planes_ = planes.get();
    terms_.push_back(std::move(planes));
    if (options.other_hands) {
      auto other_hands = std::make_unique<OtherHands>(layout, bones, mirrored_slots_);
      other_hands_ = other_hands.get();
      terms_.push_back(std::move(other_hands));
    }
  }
  // In mode symmetric the joints act in the world alone.
  if (mirrored_slots_ > 0 && object_spring.linear_stiffness == 0 && object_joints > 0) {
    auto joints = std::make_unique<ObjectJointEnergy>(layout, bones, mirrored_slots_, object_joints);
    joints_ = joints.get();
    terms_.push_back(std::move(joints));
  }
  if (mirrored_slots_ > 0 && object_spring.linear_stiffness > 0) {
    std::vector<CouplingSite> sites;
    for (int slot = 0; slot < mirrored_slots_; ++slot) sites.push_back({slot_body(slot), Pose{}, {}});
    auto objects = std::make_unique<BodyCoupling>("object_coupling", std::move(sites), layout);
    object_coupling_ = objects.get();
    terms_.push_back(std::move(objects));
  }

  std::vector<Energy*> list;
  for (const auto& term : terms_) list.push_back(term.get());
  SolverOptions solver_options = options.solver;
  solver_options.helper = helper_.get();
  // Factors with the contact of two soft bodies need a dozen iterations. Live steps are cut off long before.
  solver_options.condenses_all_contact = soft_ != nullptr;
  solver_ = std::make_unique<NewtonSolver>(std::move(list), layout, solver_options);
  std::vector<Linkage::Link> links(static_cast<std::size_t>(bones));
  for (const auto& hand : hands_) {
    for (const JointSite& joint : hand_joints(hand->model()))
      links[static_cast<std::size_t>(hand->first_body() + joint.child)] = {hand->first_body() + joint.parent,
                                                                           joint.child_from_joint.position};
  }
  node_bones_.assign(tissue.node_body.begin(), tissue.node_body.end());
  node_bones_.resize(static_cast<std::size_t>(layout.node_count), -1);
  guess_ = StepGuess(links, node_bones_);
  solver_->use_linkage(
      Linkage(layout, std::move(links), node_bones_), [this](Linkage& linkage) { return prepare(linkage); },
      [this](const Linkage& linkage, double time_step, State& state) { return guess(linkage, time_step, state); });
}

HandSimulation::~HandSimulation() = default;

// Marks the touching bones in the linkage. Returns whether the step may be a chord step (NewtonSolver::use_linkage).
bool HandSimulation::prepare(Linkage& linkage) const {
  linkage.clear_touching();
  const auto touch = [&](std::span<const std::int32_t> nodes) {
    for (const std::int32_t node : nodes) {
      const std::int32_t bone = node_bones_[static_cast<std::size_t>(node)];
      if (bone >= 0) linkage.set_touching(bone);
    }
  };
  for (const auto& hand : hands_) {
    if (hand->contacts() == nullptr) continue;
    for (const ContactSet::Anchor& anchor : hand->contacts()->anchors())
      touch(hand->contacts()->points().nodes(anchor.point));
  }
  for_each_skin([&touch](const SkinContact& skin) {
    for (const SkinAnchor& anchor : skin.anchors()) {
      touch(skin.points().nodes(anchor.point));
      touch(skin.search().corners(anchor.triangle));
    }
  });
  if (soft_ && soft_->touches()) linkage.set_loose_touching();
  return !soft_ && !linkage.any_touching() &&
         std::find(modes_.begin(), modes_.end(), SlotMode::dynamic) == modes_.end();
}

// As NewtonSolver::Guess.
bool HandSimulation::guess(const Linkage& linkage, double time_step, State& state) {
  constexpr double kLeast = 2e-3;  // m: the iterations for less cost no more than a guess
  guess_.begin(state);
  for (const auto& hand : hands_) guess_.move_bones(hand->coupling(), hand->first_body(), linkage, state);
  if (guess_.farthest() < kLeast) return false;
  guess_.move_nodes(state, time_step);
  for (int slot = 0; slot < slot_count(); ++slot) {
    if (slot_mode(slot) != SlotMode::dynamic) continue;
    guess_.begin_object();
    const bool jointed = has_joint(slot);
    for (const auto& hand : hands_) {
      if (jointed || hand->contacts() == nullptr) continue;
      for (const ContactSet::Anchor& anchor : hand->contacts()->anchors()) {
        const auto nodes = hand->contacts()->points().nodes(anchor.point);
        if (anchor.slot == slot && !nodes.empty()) guess_.touch(nodes.front(), state, slot_body(slot));
      }
    }
    guess_.move_object(state, slot_body(slot), time_step);
  }
  return true;
}

bool HandSimulation::has_joint(int slot) const {
  for (int place = 0; place < joint_count(); ++place) {
    if (!joints_->is_set(place)) continue;
    const ObjectJoint& joint = joints_->joint(place);
    if (joint.child == slot_body(slot) || joint.parent == slot_body(slot)) return true;
  }
  return false;
}

void HandSimulation::reposition(const Pose& wrist, int hand) {
  at(hand).reposition(state_, wrist);
  carpus_velocity_ = {};
  if (between_ != nullptr) between_->reset();
  stored_is_valid_ = false;
}

void HandSimulation::restore(const State& state) {
  if (state.node_positions.cols() != state_.node_positions.cols() ||
      state.node_velocities.cols() != state_.node_velocities.cols() ||
      state.body_poses.size() != state_.body_poses.size() ||
      state.body_velocities.size() != state_.body_velocities.size()) {
    throw std::invalid_argument("HandSimulation: the restored state has another layout than the hand");
  }
  state_ = state;
  for (const auto& term : terms_) term->reset_memory();
  for (const auto& hand : hands_) hand->untangler().reset();
  if (soft_) soft_->forget();
  ledger_.restart();
  stored_is_valid_ = false;
  carpus_velocity_ = {};
  restored_ = true;
}

void HandSimulation::set_target(Body body, const Pose& joint, const Twist& velocity, double strength, int hand) {
  at(hand).coupling().set_target(index_of(body), joint, velocity, strength);
}

void HandSimulation::clear_targets() {
  for (const auto& hand : hands_)
    for (int b = 0; b < kBodyCount; ++b) hand->coupling().clear_target(b);
}

void HandSimulation::set_slot(int slot, const MirroredObject& object) {
  objects_[static_cast<std::size_t>(slot)] = object;
  if (object_coupling_ != nullptr && !slot_is_static(slot)) {
    CouplingGains gains;
    gains.linear_stiffness = object_spring_.linear_stiffness;
    gains.angular_stiffness = object_spring_.angular_stiffness;
    gains.linear_damping = 2 * object_spring_.damping_ratio * std::sqrt(object_spring_.linear_stiffness * object.mass);
    gains.angular_damping =
        2 * object_spring_.damping_ratio * std::sqrt(object_spring_.angular_stiffness * object.inertia.trace() / 3);
    object_coupling_->set_gains(slot, gains);
  }
  make_kinematic(slot);
}

void HandSimulation::clear_slot(int slot) {
  modes_[static_cast<std::size_t>(slot)] = SlotMode::empty;
  inertia_->hold(slot_body(slot));
  state_.body_velocities[static_cast<std::size_t>(slot_body(slot))] = {};
  set_contact_object(slot);
  if (!slot_is_static(slot)) {
    if (planes_ != nullptr) planes_->clear_object(slot);
    if (object_coupling_ != nullptr) object_coupling_->clear_target(slot);
  }
}

void HandSimulation::set_slot_motion(int slot, const Pose& pose, const Twist& velocity) {
  state_.body_poses[static_cast<std::size_t>(slot_body(slot))] = pose;
  state_.body_velocities[static_cast<std::size_t>(slot_body(slot))] = velocity;
}

// Gives the object in the slot to the contacts.
void HandSimulation::set_contact_object(int slot) {
  const MirroredObject& object = objects_[static_cast<std::size_t>(slot)];
  const SlotMode mode = slot_mode(slot);
  for_each_contacts([&](ContactSet& contacts) {
    if (mode == SlotMode::empty) {
      contacts.clear_object(slot);
    } else {
      contacts.set_object(slot, object.shape, object.friction, object.id,
                          mode == SlotMode::dynamic ? ContactObject::moving : ContactObject::fixed);
    }
  });
}

void HandSimulation::make_kinematic(int slot) {
  modes_[static_cast<std::size_t>(slot)] = SlotMode::kinematic;
  inertia_->hold(slot_body(slot));
  set_contact_object(slot);
  if (planes_ != nullptr && !slot_is_static(slot)) planes_->clear_object(slot);
}

void HandSimulation::make_dynamic(int slot, const Vector3& gravity) {
  const MirroredObject& object = objects_[static_cast<std::size_t>(slot)];
  const bool was_dynamic = slot_mode(slot) == SlotMode::dynamic;
  modes_[static_cast<std::size_t>(slot)] = SlotMode::dynamic;
  if (planes_ != nullptr) {
    // An object that floats until it is touched has weight afterwards: use at least standard gravity.
    const double weight = object.mass * std::max(kStandardGravity, gravity.norm());
    if (was_dynamic) {
      planes_->set_weight(slot, weight);
    } else {
      planes_->set_object(slot, object.shape, object.mass, weight);
    }
  }
  inertia_->set_dynamic(slot_body(slot), object.mass, object.inertia, gravity);
  set_contact_object(slot);
}

void HandSimulation::set_object_target(int slot, const Pose& pose, const Twist& velocity) {
  object_coupling_->set_target(slot, pose, velocity);
}

// Puts the objects and joints of `other` into the same slots and places. `modes_` and `objects_` are already copied.
void HandSimulation::take_objects(const HandSimulation& other) {
  *inertia_ = *other.inertia_;  // what the caller set, and the figures of the last step
  for (int slot = 0; slot < slot_count(); ++slot) {
    set_contact_object(slot);
    if (planes_ == nullptr || slot_is_static(slot)) continue;
    const MirroredObject& object = objects_[static_cast<std::size_t>(slot)];
    planes_->clear_object(slot);
    if (slot_mode(slot) == SlotMode::dynamic) planes_->set_object(slot, object.shape, object.mass, 0);
  }
  for (int place = 0; place < joint_count(); ++place) {
    if (other.joints_->is_set(place)) {
      joints_->set_joint(place, other.joints_->joint(place));
    } else {
      joints_->clear_joint(place);
    }
  }
}

void HandSimulation::take_state(const HandSimulation& other) {
  state_ = other.state_;
  restored_ = other.restored_;
  untangled_nodes_ = other.untangled_nodes_;
  untangled_ = other.untangled_;
  modes_ = other.modes_;
  objects_ = other.objects_;
  bone_contact_forces_ = other.bone_contact_forces_;
  carpus_velocity_ = other.carpus_velocity_;
  ledger_ = other.ledger_;
  stored_ = other.stored_;
  stored_is_valid_ = other.stored_is_valid_;
  take_objects(other);
  for (std::size_t t = 0; t < terms_.size(); ++t) terms_[t]->copy_memory(*other.terms_[t]);
  for (std::size_t h = 0; h < hands_.size(); ++h) hands_[h]->untangler().load(other.hands_[h]->untangler().save());
  if (soft_) soft_->load(other.soft_->save());
  solver_->take_factor(*other.solver_);
}

StepReport HandSimulation::step(double time_step) {
  if (helper_) helper_->wake();
  // A restored state can be anything. Tissue that would throw bones and objects in the first step is put back before
  // this step and before the ledger starts.
  if (std::exchange(restored_, false)) {
    for (const auto& hand : hands_) untangled_nodes_ += static_cast<std::uint64_t>(hand->check_outside_state(state_));
  }
  if (soft_) soft_->update_passing(state_, passes_through_);
  if (between_ != nullptr) between_->set_hands_passing(passes_through_);
  if (skeleton_contact_ != nullptr) skeleton_contact_->set_hands_passing(passes_through_);
  solver_->measure_work(ledger_enabled_, ledger_enabled_ && !stored_is_valid_);
  const StepReport report = solver_->step(state_, time_step);
  if (report.timing.factorisation > 0) ++factorised_steps_;
  if (!report.state_changed) {
    for (const auto& term : terms_) term->cancel_step();
  }
  if (report.status == StepStatus::budget_spent) {
    // After a step that was cut off, tissue is out of balance, and a node's velocity does not predict its next
    // movement. But contacts are predicted from velocities. A slower velocity adds no energy.
    for (const auto& hand : hands_) hand->limit_node_velocities(state_);
  }
  if (report.state_changed) collect_bone_contacts();
  if (report.state_changed && other_hands_ != nullptr)
    follow_carpus(state_.body_velocities[kCarpus], time_step, carpus_velocity_);
  if (ledger_enabled_) enter_step(report);
  if (report.state_changed) untangle(report, time_step);
  return report;
}

void HandSimulation::untangle(const StepReport& report, double time_step) {
  int moved = 0;
  for (const auto& hand : hands_) {
    double energy = 0;
    for (std::size_t t = 0; t < terms_.size(); ++t)
      if (hand->is_tissue(terms_[t].get())) energy += report.terms[t].joules;
    moved += hand->untangle(state_, time_step, energy, *inertia_);
  }
  if (soft_) moved += soft_->untangle(state_, time_step, report.status == StepStatus::converged);
  if (moved == 0) return;
  for_each_skin([this](SkinContact& skin) { skin.release_moved(state_); });
  untangled_nodes_ += static_cast<std::uint64_t>(moved);
  untangled_ = true;
  stored_is_valid_ = false;
}

void HandSimulation::enable_ledger(bool enable) {
  if (enable && !ledger_enabled_) {
    ledger_.restart();
    stored_is_valid_ = false;
  }
  ledger_enabled_ = enable;
}

void HandSimulation::enter_step(const StepReport& report) {
  if (!report.state_changed) {
    // A step that was aborted leaves the terms' own ledger entries inconsistent. A step that did not begin changed
    // nothing.
    if (report.status == StepStatus::nonfinite) ledger_.restart();
    return;
  }
  EnergyFlow step;
  for (std::size_t t = 0; t < terms_.size(); ++t) {
    const TermEnergy& term = report.terms[t];
    // Only potentials that depend on the state alone use the start. Their energy at the end of the last step is the
    // energy at the start of this step.
    const double start = report.chord && stored_is_valid_ ? stored_[t] : term.start;
    EnergyFlow flow = terms_[t]->flow(start, term.joules, term.taken);
    // Energy change of nodes that were put back before the step. Inertia and contacts account for it themselves.
    const bool is_tissue =
        (soft_ && terms_[t].get() == &soft_->tissue()) ||
        std::any_of(hands_.begin(), hands_.end(), [&](const auto& hand) { return hand->is_tissue(terms_[t].get()); });
    if (untangled_ && is_tissue) flow.work += start - stored_[t];
    stored_[t] = flow.stored;
    step += flow;
  }
  untangled_ = false;
  stored_is_valid_ = report.measured;
  // Without the derivatives at the result, the step cannot be entered.
  if (report.measured) {
    ledger_.add(step);
  } else {
    ledger_.restart();
  }
}

Pose HandSimulation::joint_pose(Joint joint, int hand) const { return at(hand).joint_pose(state_, joint); }
Twist HandSimulation::joint_velocity(Joint joint, int hand) const { return at(hand).joint_velocity(state_, joint); }

Wrench HandSimulation::coupling_wrench(Body body, int hand) const {
  return at(hand).coupling().wrench(index_of(body), state_);
}

Wrench HandSimulation::object_coupling_wrench(int slot) const {
  return object_coupling_ == nullptr || slot_is_static(slot) ? Wrench{} : object_coupling_->wrench(slot, state_);
}

Wrench HandSimulation::joint_wrench(int slot) const {
  return joints_ == nullptr || slot_is_static(slot) ? Wrench{} : joints_->wrench(slot_body(slot));
}

Wrench HandSimulation::other_hands_wrench(int slot) const {
  return other_hands_ == nullptr || slot_is_static(slot) ? Wrench{} : other_hands_->wrench(slot);
}

int HandSimulation::joint_count() const { return joints_ == nullptr ? 0 : joints_->place_count(); }

void HandSimulation::set_joint(int place, const MirroredJoint& from) {
  ObjectJoint joint;
  joint.law = from.law;
  joint.child = slot_body(from.child_slot);
  joint.parent_from_joint = from.parent_from_joint;
  joint.child_from_joint = from.child_from_joint;
  const MirroredObject& child = objects_[static_cast<std::size_t>(from.child_slot)];
  joint.child_mass = child.mass;
  joint.child_inertia = child.inertia;
  if (from.parent_slot >= 0) {
    const MirroredObject& parent = objects_[static_cast<std::size_t>(from.parent_slot)];
    joint.parent = slot_body(from.parent_slot);
    joint.parent_mass = parent.mass;
    joint.parent_inertia = parent.inertia;
  }
  joints_->set_joint(place, joint);
  joints_->set_parent_motion(place, from.parent_pose);
}

void HandSimulation::clear_joint(int place) { joints_->clear_joint(place); }
double HandSimulation::joint_coordinate(int place) const { return joints_->coordinate(place, state_); }
double HandSimulation::joint_gap(int place) const { return joints_->gap(place, state_); }

void HandSimulation::restart_soft_object(int object) {
  const int first = soft_->first_node(object), nodes = soft_->node_count(object);
  state_.node_positions.middleCols(first, nodes) = soft_->start_positions().middleCols(first, nodes);
  state_.node_velocities.middleCols(first, nodes).setZero();
  between_->reset();
  between_->set_passing(object, true);
  if (soft_->contacts() != nullptr) soft_->contacts()->reset();
  stored_is_valid_ = false;
}

// Where `state` has the nodes of an object after `ahead` seconds: the first columns of `soft_positions_` and
// `soft_velocities_`.
void HandSimulation::read_soft_state(int object, const SoftObjectState& state, double ahead) {
  const Vector3 centre = to_vector(state.centre), velocity = to_vector(state.linear_velocity);
  for (int n = 0; n < soft_->node_count(object); ++n) {
    const auto k = static_cast<std::size_t>(n);
    soft_velocities_.col(n) = velocity + to_vector(state.velocities[k]);
    soft_positions_.col(n) = centre + to_vector(state.nodes[k]) + ahead * soft_velocities_.col(n);
  }
}

void HandSimulation::place_soft_object(int object, const SoftObjectState& state, double ahead) {
  read_soft_state(object, state, ahead);
  const int first = soft_->first_node(object), nodes = soft_->node_count(object);
  state_.node_positions.middleCols(first, nodes) = soft_positions_.leftCols(nodes);
  state_.node_velocities.middleCols(first, nodes) = soft_velocities_.leftCols(nodes);
  stored_is_valid_ = false;
}

void HandSimulation::pull_soft_object(int object, const SoftObjectState& state) {
  read_soft_state(object, state, 0);
  const int nodes = soft_->node_count(object);
  soft_couplings_[static_cast<std::size_t>(object)]->set_target(soft_positions_.leftCols(nodes),
                                                                soft_velocities_.leftCols(nodes));
}

void HandSimulation::let_go_soft_object(int object) {
  soft_couplings_[static_cast<std::size_t>(object)]->clear_target();
}

void HandSimulation::simulate_soft_objects(bool on) {
  if (!soft_ || simulates_soft_ == on) return;
  simulates_soft_ = on;
  soft_->tissue().switch_on(on);
  for (int i = 0; i < soft_->count(); ++i) {
    for (int n = soft_->first_node(i); n < soft_->first_node(i + 1); ++n)
      inertia_->set_node_gravity(n, on ? soft_->object(i).gravity : Vector3(Vector3::Zero()));
  }
  solver_->forget();
  stored_is_valid_ = false;
}

Twist HandSimulation::carrying_velocity(const Vector3& place) const {
  return at_point(carpus_velocity_, place - state_.body_poses[kCarpus].position);
}

void HandSimulation::set_planes(int slot, std::span<const NeighbourPlane> planes) {
  if (planes_ != nullptr) planes_->set_planes(slot, planes);
}

void HandSimulation::clear_other_hands() {
  if (other_hands_ != nullptr) other_hands_->clear();
}

void HandSimulation::add_other_hand(int slot, const ContactPatch& patch, const Pose& object, double age) {
  if (other_hands_ != nullptr && slot_mode(slot) == SlotMode::dynamic) other_hands_->add(slot, patch, object, age);
}

double HandSimulation::largest_coupling_stretch() const {
  double largest = 0;
  for (const auto& hand : hands_) largest = std::max(largest, hand->largest_coupling_stretch(state_));
  return largest;
}

double HandSimulation::kinetic_energy() const { return inertia_->kinetic_energy(state_); }
int HandSimulation::inverted_elements() const {
  int inverted = soft_ ? soft_->tissue().inverted_elements(state_) : 0;
  for (const auto& hand : hands_) inverted += hand->tissue() == nullptr ? 0 : hand->tissue()->inverted_elements(state_);
  return inverted;
}

WorkCounters HandSimulation::work() const {
  WorkCounters work;
  for (const auto& hand : hands_) {
    work.tissue_elements += hand->evaluated_elements();
    work.relaxing_elements += static_cast<std::uint64_t>(hand->relaxing_elements());
  }
  if (soft_) work.soft_elements = soft_->tissue().evaluated_elements();
  for_each_contacts([&](const ContactSet& contacts) {
    work.contact_queries += contacts.queries();
    work.dropped_contacts += contacts.dropped();
  });
  for_each_skin([&](const SkinContact& skin) {
    work.dropped_contacts += skin.dropped();
    work.skin_part_queries += skin.search().patches().part_queries();
    work.skin_queries += skin.search().queries();
  });
  work.factorised_steps = factorised_steps_;
  if (other_hands_ != nullptr) work.patches_used = other_hands_->patches_used();
  return work;
}

}  // namespace softhand
