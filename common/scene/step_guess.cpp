#include "scene/step_guess.hpp"

#include <algorithm>
#include <utility>

#include "math/rotation.hpp"
#include "model/skeleton.hpp"

namespace softhand {

StepGuess::StepGuess(std::vector<Linkage::Link> links, std::vector<std::int32_t> node_bodies)
    : links_(std::move(links)),
      node_bodies_(std::move(node_bodies)),
      from_(links_.size(), Vector3::Zero()),
      turns_(links_.size(), Quaternion::Identity()) {}

void StepGuess::begin(const State& state) {
  for (std::size_t bone = 0; bone < links_.size(); ++bone) from_[bone] = state.body_poses[bone].position;
  std::fill(turns_.begin(), turns_.end(), Quaternion::Identity());
  farthest_ = 0;
}

void StepGuess::move_bones(const BodyCoupling& coupling, int first_body, const Linkage& linkage, State& state) {
  const auto first = static_cast<std::size_t>(first_body);
  const auto place = [&](std::size_t b) { return first + b; };
  const auto turn_of = [&](std::size_t b, const Pose& end) {
    return (end.orientation * state.body_poses[place(b)].orientation.conjugate()).normalized();
  };
  constexpr std::size_t forearm = index_of(Body::forearm), carpus = index_of(Body::carpus);
  const auto root = coupling.followed(static_cast<int>(carpus));
  if (!root) return;
  turns_[place(carpus)] = turn_of(carpus, *root);
  state.body_poses[place(carpus)] = *root;
  // A tracker does not see the forearm.
  Pose& above = state.body_poses[place(forearm)];
  turns_[place(forearm)] = turns_[place(carpus)];
  above = {moved(place(carpus), above.position, state), (turns_[place(carpus)] * above.orientation).normalized()};
  for (std::size_t b = carpus + 1; b < kBodyCount; ++b) {
    const std::size_t bone = place(b);
    const int parent = links_[bone].parent;
    const auto end = coupling.followed(static_cast<int>(b));
    if (parent < 0) {
      if (!end) continue;
      turns_[bone] = turn_of(b, *end);
      state.body_poses[bone] = *end;
      continue;
    }
    const auto above_it = static_cast<std::size_t>(parent);
    turns_[bone] = end && !linkage.moves_straight(static_cast<int>(bone)) ? turn_of(b, *end) : turns_[above_it];
    Pose& pose = state.body_poses[bone];
    const Vector3 lever = pose.orientation * links_[bone].joint;
    pose.position = moved(above_it, from_[bone] + lever, state) - turns_[bone] * lever;
    pose.orientation = (turns_[bone] * pose.orientation).normalized();
  }
  for (std::size_t b = 0; b < kBodyCount; ++b)
    farthest_ = std::max(farthest_, (state.body_poses[place(b)].position - from_[place(b)]).norm());
}

void StepGuess::move_nodes(State& state, double time_step) const {
  for (std::size_t n = 0; n < node_bodies_.size(); ++n) {
    auto node = state.node_positions.col(static_cast<Eigen::Index>(n));
    if (node_bodies_[n] < 0) {
      node += time_step * state.node_velocities.col(static_cast<Eigen::Index>(n));
    } else {
      node = moved(static_cast<std::size_t>(node_bodies_[n]), node, state);
    }
  }
}

void StepGuess::begin_object() {
  translation_ = rotation_ = Vector3::Zero();
  contacts_ = 0;
}

void StepGuess::touch(std::int32_t node, const State& state, int object) {
  const std::int32_t bone = node_bodies_[static_cast<std::size_t>(node)];
  if (bone < 0) return;
  const Vector3& centre = state.body_poses[static_cast<std::size_t>(object)].position;
  translation_ += moved(static_cast<std::size_t>(bone), centre, state) - centre;
  rotation_ += rotation_log(turns_[static_cast<std::size_t>(bone)]);
  ++contacts_;
}

void StepGuess::move_object(State& state, int object, double time_step) const {
  Pose& pose = state.body_poses[static_cast<std::size_t>(object)];
  if (contacts_ > 0) {
    pose = increment(pose, translation_ / contacts_, rotation_ / contacts_);
  } else {
    pose = advanced(pose, state.body_velocities[static_cast<std::size_t>(object)], time_step);
  }
}

}  // namespace softhand
