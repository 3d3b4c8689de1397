#include "scene/untangle.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "math/tetrahedron.hpp"

namespace softhand {
namespace {

constexpr double kTwistedEnergy = 20e-3;  // J to release; a hand's tissue under its own weight holds 1 mJ
constexpr double kAtRest = 0.1;           // largest kinetic energy, relative to the released energy
// Rings of neighbours that move with a cluster. The last value means the whole connected tissue.
constexpr std::array<int, 6> kRings{1, 2, 4, 8, 16, 1000};
constexpr double kExtraRelease = 0.1;   // relative extra energy that a larger region must release
constexpr double kReleasedShare = 0.5;  // share of the energy that must be released if it exceeds `mirrored_energy_`
constexpr double kReleasedTangledShare = 0.5;  // share of the tangled tetrahedra's energy that must be released
// J that putting back a hook may cost: a bone may pull it with all of its coupling's force, 20 N, over 10 mm.
constexpr double kHookCost = 0.2;
constexpr int kClustersPerFullCheck = 2;  // each costs a dozen evaluations of the tissue's energy
constexpr std::uint8_t kPause = 4;        // full checks to skip after a try that released nothing

Vector3 nearest_on_segment(const Vector3& from, const Vector3& to, const Vector3& point) {
  const Vector3 along = to - from;
  const double squared = along.squaredNorm();
  return squared > 0 ? Vector3(from + std::clamp(along.dot(point - from) / squared, 0.0, 1.0) * along) : from;
}

}  // namespace

Untangler::Untangler(const HandModel& hand, double full_check_period, int first_node, int first_body)
    : full_check_period_(full_check_period),
      first_node_(static_cast<std::size_t>(first_node)),
      persistent_(hand.tetrahedra.size(), 0) {
  memory_.tangled.assign(hand.tetrahedra.size(), 0);
  memory_.wait.assign(hand.tetrahedra.size(), 0);
  const std::size_t nodes = first_node_ + hand.nodes.size();
  for (std::vector<std::uint8_t>* marks : {&node_body_, &hooked_, &move_, &more_, &best_}) marks->assign(nodes, 0);
  rest_in_body_.resize(nodes);
  bone_in_body_.resize(nodes);
  positions_ = velocities_ = Eigen::Matrix3Xd::Zero(3, hand.node_count());
  bones_ = Eigen::Matrix3Xd::Zero(3, static_cast<Eigen::Index>(nodes));
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    const std::uint8_t bone = hand.node_body[n];
    const BodyModel& body = hand.bodies[bone];
    const Pose body_from_rest = hand.body_rest_pose(static_cast<Body>(bone)).inverse();
    const Pose body_from_joint = body.joint_from_body.inverse();
    const std::size_t node = first_node_ + n;
    node_body_[node] = static_cast<std::uint8_t>(first_body + bone);
    rest_in_body_[node] = body_from_rest * hand.nodes[n];
    bone_in_body_[node] =
        nearest_on_segment(body_from_joint * body.bone_start, body_from_joint * body.bone_end, rest_in_body_[node]);
  }
  Eigen::Matrix3Xd rest(3, hand.node_count());
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) rest.col(static_cast<Eigen::Index>(n)) = hand.nodes[n];
  for (std::size_t t = 0; t < hand.tetrahedra.size(); ++t) {
    const Material& m = hand.materials[hand.tetrahedron_material[t]];
    const CorotationalMaterial law = corotational_material(m);
    mirrored_energies_.push_back(std::abs(tetrahedron_volume(rest, hand.tetrahedra[t])) * flip_density(law));
    mirrored_energy_ += mirrored_energies_.back();
    auto corners = hand.tetrahedra[t];
    for (std::int32_t& corner : corners) corner += first_node;
    tetrahedra_.push_back(corners);
  }
}

void Untangler::load(const Memory& memory) {
  if (memory.tangled.size() != memory_.tangled.size() || memory.wait.size() != memory_.wait.size())
    throw std::invalid_argument("untangler: the memory has " + std::to_string(memory.tangled.size()) +
                                " tetrahedra, expected " + std::to_string(memory_.tangled.size()));
  memory_ = memory;
}

void Untangler::reset() {
  memory_.waited = 0;
  memory_.quick_check_done = memory_.twisted = false;
  std::fill(memory_.tangled.begin(), memory_.tangled.end(), std::uint8_t{0});
  std::fill(memory_.wait.begin(), memory_.wait.end(), std::uint8_t{0});
}

void Untangler::put_back(const View& view, std::size_t node) const {
  State& state = view.state;
  const auto column = static_cast<Eigen::Index>(node);
  const Pose& body = state.body_poses[node_body_[node]];
  const Twist& velocity = state.body_velocities[node_body_[node]];
  const Vector3 lever = body.orientation * rest_in_body_[node];
  Vector3 position = body.position + lever;
  if (view.contacts != nullptr)
    position = view.contacts->stopped(state, static_cast<std::int32_t>(node), bones_.col(column), position);
  state.node_positions.col(column) = position;
  state.node_velocities.col(column) = velocity.linear + velocity.angular.cross(lever);
}

Untangler::Due Untangler::due(double time_step, double energy) {
  if (full_check_period_ <= 0) return Due::nothing;
  memory_.waited += time_step;
  if (memory_.waited >= full_check_period_) {
    memory_.waited = 0;
    memory_.quick_check_done = false;
    return Due::full_check;
  }
  // A quick check that found no lower energy is not repeated in every step.
  return energy > mirrored_energy_ && !std::exchange(memory_.quick_check_done, true) ? Due::quick_check : Due::nothing;
}

double Untangler::stored(const View& view) const {
  double joules = 0;
  for (const Energy* energy : view.energies) joules += energy->value(view.state);
  return joules;
}

void Untangler::move_all_back(const View& view) {
  std::fill(move_.begin() + static_cast<std::ptrdiff_t>(first_node_), move_.end(), std::uint8_t{1});
  for (std::size_t n = first_node_; n < move_.size(); ++n) put_back(view, n);
}

// Energy in J released by putting back `move_`. `before`: the stored energy before. The contacts of the nodes are still
// those from before.
double Untangler::released_energy(const View& view, double before) const {
  double released = before - stored(view);
  if (view.contacts != nullptr)
    released += view.contacts->stored_energy(move_) - view.contacts->stored_energy_at(view.state, move_, bones_);
  return released;
}

void Untangler::place_bones(const State& state) {
  for (std::size_t n = first_node_; n < node_body_.size(); ++n)
    bones_.col(static_cast<Eigen::Index>(n)) = state.body_poses[node_body_[n]] * bone_in_body_[n];
}

// Accepts the new places of the nodes in `move_`: ends their contacts. Returns the number of nodes.
int Untangler::accept_move(const View& view) {
  if (view.contacts != nullptr) view.contacts->release(move_);
  // The marks from before the move say nothing about the state after it.
  std::fill(memory_.tangled.begin(), memory_.tangled.end(), 0);
  return static_cast<int>(std::count(move_.begin(), move_.end(), 1));
}

// Tissue at rest has at most the energy of the rest shape moved rigidly with the bones, because it could relax from
// there. Tissue at rest with more energy is caught in another minimum.
int Untangler::put_all_back(const View& view, double kinetic_energy, bool tests_twist) {
  State& state = view.state;
  const double before = stored(view);
  place_bones(state);
  // Tissue pressed around an edge may have more energy than if it were put back. So if there are no inverted tetrahedra
  // or hooks, only a hand without contacts can count as twisted.
  tests_twist = tests_twist && (view.contacts == nullptr || view.contacts->count() == 0);
  if (!tests_twist) memory_.twisted = false;
  if (!tests_twist && before <= mirrored_energy_) return 0;
  positions_ = own(state.node_positions);
  velocities_ = own(state.node_velocities);
  move_all_back(view);
  const double released = released_energy(view, before);
  bool tangled = before > mirrored_energy_ && released > kReleasedShare * before;
  if (tangled && put_worst_back(view, before, released)) return accept_move(view);
  if (tests_twist) {
    const bool was_twisted =
        std::exchange(memory_.twisted, released > kTwistedEnergy && kinetic_energy < kAtRest * released);
    tangled = tangled || (memory_.twisted && was_twisted);
  }
  if (tangled) {
    memory_.twisted = false;
    return accept_move(view);
  }
  own(state.node_positions).swap(positions_);
  own(state.node_velocities).swap(velocities_);
  return 0;
}

// All of the tissue is put back and has released `released_by_all` J. Puts back only the tetrahedra that are folded or
// have more energy than if they were mirrored. Rings around them follow until nearly as much is released. So tissue
// far from the tangle keeps its place and its contacts. Returns false, with all of the tissue put back, if only that
// releases enough.
bool Untangler::put_worst_back(const View& view, double before, double released_by_all) {
  State& state = view.state;
  own(state.node_positions) = positions_;
  own(state.node_velocities) = velocities_;
  std::fill(move_.begin(), move_.end(), std::uint8_t{0});
  for (std::size_t t = 0; t < tetrahedra_.size(); ++t) {
    if (!view.tissue.is_folded(state, static_cast<int>(t)) &&
        !(view.tissue.energy(state, static_cast<int>(t)) > mirrored_energies_[t]))
      continue;
    for (const std::int32_t n : tetrahedra_[t]) move_[static_cast<std::size_t>(n)] = 1;
  }
  int rings = 0;
  for (const int ring_count : kRings) {
    int grown = 1;
    for (; rings < ring_count && grown > 0; ++rings) grown = grow();
    if (grown == 0) break;
    for (std::size_t n = 0; n < move_.size(); ++n) {
      if (move_[n] != 0) put_back(view, n);
    }
    if (released_energy(view, before) >= released_by_all - kExtraRelease * std::abs(released_by_all)) return true;
  }
  move_all_back(view);
  return false;
}

// Adds the nodes that share a tetrahedron with a node of `move_`. Returns the number of added nodes.
int Untangler::grow() {
  int grown = 0;
  more_ = move_;
  for (const auto& nodes : tetrahedra_) {
    if (std::none_of(nodes.begin(), nodes.end(),
                     [this](std::int32_t n) { return move_[static_cast<std::size_t>(n)] != 0; }))
      continue;
    for (const std::int32_t n : nodes)
      grown += std::exchange(more_[static_cast<std::size_t>(n)], std::uint8_t{1}) == 0 ? 1 : 0;
  }
  move_.swap(more_);
  return grown;
}

// Puts back the tangled tetrahedra that are connected with `seed`, and as many rings around them as release the most
// energy. A hook may store its energy in bones that it keeps from their targets. So a cluster with a hook is also put
// back if tissue and contact release nothing. But soft skin that is pressed bulges behind an edge. It would need much
// more energy there if it had its shape of rest.
int Untangler::untangle_cluster(const View& view, std::size_t seed) {
  State& state = view.state;
  std::fill(move_.begin(), move_.end(), 0);
  double tangled_energy = 0;
  bool hooks = false;
  for (const std::int32_t n : tetrahedra_[seed]) move_[static_cast<std::size_t>(n)] = 1;
  for (bool grown = true; grown;) {
    grown = false;
    for (std::size_t t = seed; t < tetrahedra_.size(); ++t) {
      const auto& nodes = tetrahedra_[t];
      if (persistent_[t] == 0 || std::none_of(nodes.begin(), nodes.end(), [this](std::int32_t n) {
            return move_[static_cast<std::size_t>(n)] != 0;
          }))
        continue;
      for (const std::int32_t n : nodes) {
        move_[static_cast<std::size_t>(n)] = 1;
        hooks = hooks || hooked_[static_cast<std::size_t>(n)] != 0;
      }
      tangled_energy += view.tissue.energy(state, static_cast<int>(t));
      persistent_[t] = 0;
      memory_.wait[t] = kPause;
      grown = true;
    }
  }
  const double before = stored(view);
  positions_ = own(state.node_positions);
  velocities_ = own(state.node_velocities);
  double most = hooks ? -kHookCost : kReleasedTangledShare * tangled_energy;
  bool found = false;
  int rings = 0;
  for (const int ring_count : kRings) {
    int grown = 1;
    for (; rings < ring_count && grown > 0; ++rings) grown = grow();
    for (std::size_t n = 0; n < move_.size(); ++n) {
      if (move_[n] != 0) put_back(view, n);
    }
    const double released = released_energy(view, before);
    if (found ? released - most > kExtraRelease * std::abs(most) : released > most) {
      most = released;
      best_ = move_;
      found = true;
    }
    if (grown == 0) break;
  }
  own(state.node_positions) = positions_;
  own(state.node_velocities) = velocities_;
  if (!found) return 0;
  move_ = best_;
  for (std::size_t n = 0; n < move_.size(); ++n) {
    if (move_[n] != 0) put_back(view, n);
  }
  return accept_move(view);
}

int Untangler::quick_check(State& state, ContactSet* contacts, const Tissue& tissue,
                           std::span<const Energy* const> energies) {
  return full_check_period_ > 0 ? put_all_back({state, contacts, tissue, energies}, 0, false) : 0;
}

int Untangler::full_check(State& state, ContactSet* contacts, double kinetic_energy, const Tissue& tissue,
                          std::span<const Energy* const> energies) {
  const View view{state, contacts, tissue, energies};
  if (const int moved = put_all_back(view, kinetic_energy, true)) return moved;
  if (contacts != nullptr) contacts->mark_hooked(state, bones_, hooked_);
  for (std::size_t t = 0; t < tetrahedra_.size(); ++t) {
    const auto& nodes = tetrahedra_[t];
    const bool hooked = std::any_of(nodes.begin(), nodes.end(),
                                    [this](std::int32_t n) { return hooked_[static_cast<std::size_t>(n)] != 0; });
    const bool tangled = hooked || tissue.is_folded(state, static_cast<int>(t));
    if (!tangled) {
      memory_.wait[t] = 0;
    } else if (memory_.wait[t] > 0) {
      --memory_.wait[t];
    }
    persistent_[t] = tangled && memory_.tangled[t] != 0 && memory_.wait[t] == 0 ? 1 : 0;
    memory_.tangled[t] = tangled ? 1 : 0;
  }
  int moved = 0, clusters = 0;
  for (std::size_t t = 0; t < tetrahedra_.size() && clusters < kClustersPerFullCheck; ++t) {
    if (persistent_[t] == 0) continue;
    moved += untangle_cluster(view, t);
    ++clusters;
  }
  return moved;
}

}  // namespace softhand
