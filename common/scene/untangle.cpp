#include "scene/untangle.hpp"

#include <algorithm>

namespace softhand {
namespace {

constexpr std::array<int, 3> kRings{1, 3, 1000};  // of neighbours that go along, by attempt; the last: everything that hangs together

}  // namespace

Untangler::Untangler(const HandModel& hand, double patience)
    : patience_(patience),
      tetrahedra_(hand.tetrahedra),
      node_body_(hand.node_body),
      inverted_(hand.tetrahedra.size(), 0),
      move_(hand.nodes.size(), 0),
      more_(hand.nodes.size(), 0) {
  for (std::size_t n = 0; n < hand.nodes.size(); ++n) {
    const BodyModel& body = hand.bodies[node_body_[n]];
    const Pose rest = hand.rest_joints[static_cast<std::size_t>(index_of(joint_of(static_cast<Body>(node_body_[n]))))] * body.joint_from_body;
    rest_in_body_.push_back(rest.inverse() * hand.nodes[n]);
  }
}

int Untangler::after_step(State& state, double time_step, std::span<const std::uint8_t> touching) {
  if (patience_ <= 0) return 0;
  waited_ += time_step;
  if (waited_ < patience_) return 0;
  waited_ = 0;

  bool any_free = false, tangled = false;
  std::fill(move_.begin(), move_.end(), 0);
  for (std::size_t t = 0; t < tetrahedra_.size(); ++t) {
    const auto& nodes = tetrahedra_[t];
    const auto x = [&state, &nodes](std::size_t k) { return Vector3(state.node_positions.col(nodes[k])); };
    const bool inverted = (x(1) - x(0)).dot((x(2) - x(0)).cross(x(3) - x(0))) < 0;
    const bool stays = inverted && inverted_[t] != 0;
    inverted_[t] = inverted ? 1 : 0;
    if (!inverted || std::any_of(nodes.begin(), nodes.end(), [&touching](std::int32_t n) { return touching[static_cast<std::size_t>(n)] != 0; })) continue;
    any_free = true;
    if (!stays) continue;
    tangled = true;
    for (const std::int32_t n : nodes) move_[static_cast<std::size_t>(n)] = 1;
  }
  if (!any_free) attempts_ = 0;
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
    const Pose& body = state.body_poses[node_body_[n]];
    const Twist& velocity = state.body_velocities[node_body_[n]];
    const Vector3 lever = body.orientation * rest_in_body_[n];
    state.node_positions.col(static_cast<Eigen::Index>(n)) = body.position + lever;
    state.node_velocities.col(static_cast<Eigen::Index>(n)) = velocity.linear + velocity.angular.cross(lever);
    ++moved;
  }
  // What was inverted before the stroke says nothing about after it.
  std::fill(inverted_.begin(), inverted_.end(), 0);
  return moved;
}

}  // namespace softhand
