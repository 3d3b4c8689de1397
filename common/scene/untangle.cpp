#include "scene/untangle.hpp"

#include <algorithm>
#include <utility>

namespace softhand {
namespace {

constexpr double kTwistedEnergy = 20e-3;  // J; a hand's tissue under its own weight holds 1 mJ
constexpr double kAtRest = 0.1;           // of it may be motion
constexpr std::array<int, 3> kRings{1, 3, 1000};  // of neighbours that go along, by attempt; the last: everything that hangs together

}  // namespace

Untangler::Untangler(const HandModel& hand, double patience)
    : patience_(patience),
      tetrahedra_(hand.tetrahedra),
      node_body_(hand.node_body),
      folded_(hand.tetrahedra.size(), 0),
      move_(hand.nodes.size(), 0),
      more_(hand.nodes.size(), 0) {
  carried_.node_positions = carried_.node_velocities = Eigen::Matrix3Xd::Zero(3, hand.node_count());
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    rest_in_body_.push_back(hand.body_rest_pose(static_cast<Body>(node_body_[n])).inverse() * hand.nodes[n]);
  }
}

void Untangler::put_back(State& state, std::size_t node) const {
  const Pose& body = state.body_poses[node_body_[node]];
  const Twist& velocity = state.body_velocities[node_body_[node]];
  const Vector3 lever = body.orientation * rest_in_body_[node];
  state.node_positions.col(static_cast<Eigen::Index>(node)) = body.position + lever;
  state.node_velocities.col(static_cast<Eigen::Index>(node)) = velocity.linear + velocity.angular.cross(lever);
}

// Tissue that rests, touching nothing, goes to where the bones carry it or below that in energy: it would, from there. What holds more is caught in another minimum.
int Untangler::untwist(State& state, double kinetic_energy, const Tissue& tissue, const Energy& attachments) {
  const auto energy = [&] { return tissue.value(state) + attachments.value(state); };
  const double held = energy();
  carried_.node_positions = state.node_positions;
  carried_.node_velocities = state.node_velocities;
  for (std::size_t n = 0; n < node_body_.size(); ++n) put_back(state, n);
  const double excess = held - energy();
  const bool stays = std::exchange(twisted_, excess > kTwistedEnergy && kinetic_energy < kAtRest * excess);
  if (twisted_ && stays) {
    twisted_ = false;
    return static_cast<int>(node_body_.size());
  }
  state.node_positions.swap(carried_.node_positions);
  state.node_velocities.swap(carried_.node_velocities);
  return 0;
}

bool Untangler::due(double time_step) {
  if (patience_ <= 0) return false;
  waited_ += time_step;
  if (waited_ < patience_) return false;
  waited_ = 0;
  return true;
}

int Untangler::look(State& state, std::span<const std::uint8_t> touching, double kinetic_energy, const Tissue& tissue, const Energy& attachments) {
  bool any_free = false, tangled = false;
  std::fill(move_.begin(), move_.end(), 0);
  for (std::size_t t = 0; t < tetrahedra_.size(); ++t) {
    const auto& nodes = tetrahedra_[t];
    const bool folded = tissue.is_folded(state, static_cast<int>(t));
    const bool stays = folded && folded_[t] != 0;
    folded_[t] = folded ? 1 : 0;
    if (!folded || std::any_of(nodes.begin(), nodes.end(), [&touching](std::int32_t n) { return touching[static_cast<std::size_t>(n)] != 0; })) continue;
    any_free = true;
    if (!stays) continue;
    tangled = true;
    for (const std::int32_t n : nodes) move_[static_cast<std::size_t>(n)] = 1;
  }
  if (!any_free) attempts_ = 0;
  if (!any_free && std::find(touching.begin(), touching.end(), 1) == touching.end()) return untwist(state, kinetic_energy, tissue, attachments);
  if (!tangled || attempts_ >= static_cast<int>(kRings.size())) return 0;
  for (int ring = 0, grown = 1; ring < kRings[static_cast<std::size_t>(attempts_)] && grown > 0; ++ring) {
    more_ = move_;
    grown = 0;
    for (const auto& nodes : tetrahedra_) {
      if (std::none_of(nodes.begin(), nodes.end(), [this](std::int32_t n) { return move_[static_cast<std::size_t>(n)] != 0; })) continue;
      for (const std::int32_t n : nodes) {
        std::uint8_t& moves = more_[static_cast<std::size_t>(n)];
        grown += moves == 0 ? 1 : 0;
        moves = 1;
      }
    }
    move_.swap(more_);
  }
  ++attempts_;
  int moved = 0;
  for (std::size_t n = 0; n < move_.size(); ++n) {
    if (move_[n] == 0) continue;
    put_back(state, n);
    ++moved;
  }
  // What was folded before the stroke says nothing about after it.
  std::fill(folded_.begin(), folded_.end(), 0);
  return moved;
}

}  // namespace softhand
