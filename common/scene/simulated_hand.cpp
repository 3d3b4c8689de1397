#include "scene/simulated_hand.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "energies/body_coupling.hpp"
#include "energies/friction.hpp"
#include "energies/inertia.hpp"
#include "energies/joint.hpp"
#include "energies/skeleton_tissue.hpp"
#include "energies/skin_contact.hpp"
#include "math/index.hpp"

namespace softhand {
namespace {

// By bone: its own mass plus the mass of the tissue that is nearest to it. It determines the critical damping.
std::array<double, kBodyCount> attached_masses(const HandModel& hand) {
  std::array<double, kBodyCount> masses{};
  for (std::size_t b = 0; b < kBodyCount; ++b) masses[b] = hand.bodies[b].mass;
  const std::vector<double> node_masses = lumped_masses(hand);
  for (std::size_t n = 0; n < node_masses.size(); ++n) masses[hand.node_body[n]] += node_masses[n];
  return masses;
}

// The branches of each material of the hand. Throws std::invalid_argument with the name of the option.
PronySeries prony_series(const HandModel& hand, const RelaxationOptions& options) {
  if (!options.active) return {};
  const std::array<std::pair<std::string_view, PronySeries::Branches>, 4> known{
      {{"pulp", options.pulp}, {"palm", options.palm}, {"back", options.back}, {"knuckle", options.knuckle}}};
  PronySeries series{options.time_constants, {hand.materials.size(), PronySeries::Branches{}}};
  for (const auto& [name, weights] : known) {
    const double sum = std::accumulate(weights.begin(), weights.end(), 0.0);
    if (!(sum < 1))
      throw std::invalid_argument("hand.simulation.relaxation." + std::string(name) +
                                  ": expected weights with a sum below 1, got " + std::to_string(sum));
    for (std::size_t m = 0; m < series.weights.size(); ++m) {
      if (hand.materials[m].name == name) series.weights[m] = weights;
    }
  }
  return series;
}

std::vector<CouplingSite> coupling_sites(const HandModel& hand, int first_body, double damping_ratio) {
  const auto attached = attached_masses(hand);
  std::vector<CouplingSite> bones;
  for (int b = 0; b < kBodyCount; ++b) {
    const BodyModel& body = hand.bodies[at(b)];
    CouplingGains gains;
    gains.linear_stiffness = body.coupling_linear_stiffness;
    gains.angular_stiffness = body.coupling_angular_stiffness;
    gains.linear_damping = 2 * damping_ratio * std::sqrt(body.coupling_linear_stiffness * attached[at(b)]);
    const double turning_inertia = body.inertia.trace() / 3 * attached[at(b)] / body.mass;
    gains.angular_damping = 2 * damping_ratio * std::sqrt(body.coupling_angular_stiffness * turning_inertia);
    gains.force_cap = body.coupling_force_cap;
    gains.torque_cap = body.coupling_torque_cap;
    bones.push_back({first_body + b, body.joint_from_body.inverse(), gains});
  }
  return bones;
}

}  // namespace

SimulatedHand::SimulatedHand(const HandModel& model, int first_node, int first_body, const SimulationOptions& options)
    : model_(model),
      first_node_(first_node),
      first_body_(first_body),
      untangler_(model, options.untangle_patience, first_node, first_body) {
  for (int j = 0; j < kJointCount; ++j) {
    const Joint joint = static_cast<Joint>(j);
    joint_in_body_[slot_of(joint)] =
        model_.body_rest_pose(body_of(joint)).inverse() * model_.rest_joints[slot_of(joint)];
  }
}

TissueModel SimulatedHand::placed_tissue() const {
  TissueModel placed = model_;
  const auto own_body = [this](std::uint8_t& body) { body = static_cast<std::uint8_t>(first_body_ + body); };
  std::for_each(placed.node_body.begin(), placed.node_body.end(), own_body);
  for (SkinPoint& point : placed.contact_points) own_body(point.body);
  placed.nodes.insert(placed.nodes.begin(), at(first_node_), Vector3::Zero());
  placed.node_body.insert(placed.node_body.begin(), at(first_node_), static_cast<std::uint8_t>(first_body_));
  for (auto& corners : placed.tetrahedra)
    for (std::int32_t& corner : corners) corner += first_node_;
  for (auto& corners : placed.surface)
    for (std::int32_t& corner : corners) corner += first_node_;
  return placed;
}

void append_tissue(TissueModel& all, const TissueModel& placed) {
  const auto append = [](auto& to, const auto& from, std::size_t first = 0) {
    to.insert(to.end(), from.begin() + static_cast<std::ptrdiff_t>(first), from.end());
  };
  const auto first_tetrahedron = static_cast<std::int32_t>(all.tetrahedra.size());
  const std::size_t first_material = all.materials.size(), first_point = all.contact_points.size();
  const std::size_t first_node = all.nodes.size();
  append(all.nodes, placed.nodes, first_node);
  append(all.node_body, placed.node_body, first_node);
  append(all.tetrahedra, placed.tetrahedra);
  append(all.materials, placed.materials);
  for (const std::uint8_t material : placed.tetrahedron_material)
    all.tetrahedron_material.push_back(static_cast<std::uint8_t>(first_material + material));
  append(all.surface, placed.surface);
  append(all.contact_points, placed.contact_points);
  for (std::size_t p = first_point; p < all.contact_points.size(); ++p)
    all.contact_points[p].tetrahedron += first_tetrahedron;
}

void SimulatedHand::add_terms(const SimulationOptions& options, DofLayout layout, int mirrored_slots, int slots,
                              HelperThread* helper, std::vector<std::unique_ptr<Energy>>& terms) {
  const TissueModel tissue_model = placed_tissue();
  const std::vector<double> masses = lumped_masses(tissue_model);
  const bool single_hessian = options.solver.factor == "float" && options.solver.curvature != "exact";
  if (!model_.tetrahedra.empty()) {
    const PronySeries relaxation = prony_series(model_, options.relaxation);
    auto tissue = std::make_unique<Tissue>(tissue_model, widest_instruction_set(), "tissue", relaxation);
    tissue_ = tissue.get();
    const auto add = [&](auto of_elements) {
      if (helper != nullptr) of_elements->use(*helper);
      if (single_hessian) of_elements->use_single_hessian();
      holding_tissue_.push_back(of_elements.get());
      terms.push_back(std::move(of_elements));
    };
    add(std::move(tissue));
    if (!relaxation.tetrahedra(tissue_model, true).empty()) {
      auto relaxing = std::make_unique<RelaxingTissue>(tissue_model, relaxation);
      relaxing_ = relaxing.get();
      add(std::move(relaxing));
    }
    auto attachments = std::make_unique<SkeletonTissue>(model_, layout, first_node_, first_body_);
    holding_tissue_.push_back(attachments.get());
    terms.push_back(std::move(attachments));
  }
  std::vector<JointSite> joints = hand_joints(model_);
  for (JointSite& joint : joints) {
    joint.parent += first_body_;
    joint.child += first_body_;
  }
  terms.push_back(std::make_unique<JointEnergy>(joints, layout));
  auto coupling = std::make_unique<BodyCoupling>(
      "coupling", coupling_sites(model_, first_body_, options.coupling_damping_ratio), layout);
  coupling_ = coupling.get();
  terms.push_back(std::move(coupling));
  if (slots > 0) {
    contacts_ =
        std::make_unique<ContactSet>(ContactPoints(tissue_model, masses), layout.node_count, options.contact_stiffness,
                                     layout.body_count - slots, mirrored_slots, slots);
    terms.push_back(std::make_unique<ContactEnergy>(*contacts_));
    terms.push_back(std::make_unique<FrictionEnergy>(*contacts_));
  }
  if (options.skin_contact && tissue_ != nullptr) {
    auto skin = std::make_unique<SkinContact>(tissue_model, masses, options.contact_stiffness, options.skin_friction);
    skin_ = skin.get();
    terms.push_back(std::move(skin));
  }
}

void SimulatedHand::set_masses(Inertia& inertia, const Vector3& gravity) const {
  for (int b = 0; b < kBodyCount; ++b)
    inertia.set_dynamic(first_body_ + b, model_.bodies[at(b)].mass, model_.bodies[at(b)].inertia, gravity);
}

void SimulatedHand::reposition(State& state, const Pose& wrist) {
  const Pose move = wrist * joint_pose(state, Joint::wrist).inverse();
  for (int n = first_node_; n < first_node_ + model_.node_count(); ++n) {
    state.node_positions.col(n) = move * Vector3(state.node_positions.col(n));
    state.node_velocities.col(n).setZero();
  }
  for (int b = first_body_; b < first_body_ + kBodyCount; ++b) {
    state.body_poses[at(b)] = move * state.body_poses[at(b)];
    state.body_velocities[at(b)] = {};
  }
  if (contacts_) contacts_->reset();
}

Pose SimulatedHand::joint_pose(const State& state, Joint joint) const {
  return state.body_poses[at(body(body_of(joint)))] * joint_in_body_[slot_of(joint)];
}

Twist SimulatedHand::joint_velocity(const State& state, Joint joint) const {
  const std::size_t b = at(body(body_of(joint)));
  const Vector3 lever = state.body_poses[b].orientation * joint_in_body_[slot_of(joint)].position;
  const Twist& velocity = state.body_velocities[b];
  return {velocity.linear + velocity.angular.cross(lever), velocity.angular};
}

void SimulatedHand::limit_node_velocities(State& state) const {
  for (int n = 0; n < model_.node_count(); ++n) {
    const std::size_t bone = at(first_body_) + model_.node_body[at(n)];
    auto velocity = state.node_velocities.col(first_node_ + n);
    const Vector3 lever = state.node_positions.col(first_node_ + n) - state.body_poses[bone].position;
    const Vector3 of_bone = state.body_velocities[bone].linear + state.body_velocities[bone].angular.cross(lever);
    if (of_bone.squaredNorm() < velocity.squaredNorm()) velocity = of_bone;
  }
}

double SimulatedHand::largest_coupling_stretch(const State& state) const {
  double largest = 0;
  for (int b = 0; b < kBodyCount; ++b) largest = std::max(largest, coupling_->stretch(b, state));
  return largest;
}

int SimulatedHand::untangle(State& state, double time_step, double tissue_energy, const Inertia& inertia) {
  if (tissue_ == nullptr) return 0;
  int moved = 0;
  switch (untangler_.due(time_step, tissue_energy)) {
    case Untangler::Due::full_check:
      moved = untangler_.full_check(state, contacts_.get(), inertia.kinetic_energy(state), *tissue_, holding_tissue_);
      break;
    case Untangler::Due::quick_check:
      moved = check_outside_state(state);
      break;
    case Untangler::Due::nothing:
      break;
  }
  if (moved > 0 && relaxing_ != nullptr) relaxing_->reset_moved(state);
  return moved;
}

std::uint64_t SimulatedHand::evaluated_elements() const {
  return (tissue_ == nullptr ? 0 : tissue_->evaluated_elements()) +
         (relaxing_ == nullptr ? 0 : relaxing_->evaluated_elements());
}

int SimulatedHand::check_outside_state(State& state) {
  return tissue_ == nullptr ? 0 : untangler_.quick_check(state, contacts_.get(), *tissue_, holding_tissue_);
}

}  // namespace softhand
