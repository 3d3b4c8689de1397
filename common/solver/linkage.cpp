#include "solver/linkage.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "math/rotation.hpp"

namespace softhand {

Linkage::Linkage(DofLayout layout, std::vector<Link> links, std::vector<std::int32_t> node_bodies)
    : layout_(layout),
      links_(std::move(links)),
      node_bodies_(std::move(node_bodies)),
      levers_(links_.size(), Vector3::Zero()),
      tangent_(VectorX::Zero(layout.dof_count())) {
  resize_bodies();
  if (node_bodies_.size() != static_cast<std::size_t>(layout.node_count))
    throw std::invalid_argument("Linkage: expected one body per node");
  if (links_.size() > earlier_orientations_.size()) throw std::invalid_argument("Linkage: more links than bodies");
  for (std::size_t b = 0; b < links_.size(); ++b) {
    if (links_[b].parent >= static_cast<int>(b))
      throw std::invalid_argument("Linkage: a parent must have a smaller index than its children");
  }
  for (const std::int32_t body_of_node : node_bodies_) {
    if (body_of_node < -1 || body_of_node >= layout.body_count)
      throw std::invalid_argument("Linkage: the body of a node is not a body of the state");
  }
}

void Linkage::resize_bodies() {
  const auto bodies = static_cast<std::size_t>(layout_.body_count);
  is_straight_.assign(bodies, 0);
  earlier_orientations_.assign(bodies, Quaternion::Identity());
  turns_.assign(bodies, Matrix3::Identity());
  coasted_.assign(bodies, Matrix3::Identity());
  then_.assign(bodies, Vector3::Zero());
  now_.assign(bodies, Vector3::Zero());
}

void Linkage::clear_touching() {
  std::fill(is_straight_.begin(), is_straight_.end(), std::uint8_t{0});
  any_touching_ = false;
}

void Linkage::set_touching(int body) {
  any_touching_ = true;
  while (body >= 0 && !is_straight_[static_cast<std::size_t>(body)]) {
    is_straight_[static_cast<std::size_t>(body)] = 1;
    body = body < linked_bodies() ? links_[static_cast<std::size_t>(body)].parent : -1;
  }
}

void Linkage::straighten() { std::fill(is_straight_.begin(), is_straight_.end(), std::uint8_t{1}); }

void Linkage::move(State& state, const VectorX& increment, double scale) {
  for (int body = 0; body < layout_.body_count; ++body) {
    const auto b = static_cast<std::size_t>(body);
    const Vector3 linear = increment.segment<3>(translation(body)), angular = increment.segment<3>(rotation(body));
    Pose& pose = state.body_poses[b];
    then_[b] = pose.position;
    now_[b] = linear;
    coasted_[b] = rotation_exp(scale * angular).toRotationMatrix();
    const int parent = b < links_.size() && !is_straight_[b] ? links_[b].parent : -1;
    const Vector3 lever = parent < 0 ? Vector3(Vector3::Zero()) : Vector3(pose.orientation * links_[b].joint);
    pose = softhand::increment(pose, scale * linear, scale * angular);
    if (parent >= 0) {
      const auto a = static_cast<std::size_t>(parent);
      const Vector3 parent_angular = increment.segment<3>(rotation(parent));
      const Vector3 arm = then_[b] + lever - then_[a];  // from the parent to the joint
      // Displacement of the joint in the child relative to the joint in the parent, by the increment.
      const Vector3 gap =
          linear + angular.cross(lever) - increment.segment<3>(translation(parent)) - parent_angular.cross(arm);
      const Vector3 turned_arm = coasted_[a] * (arm + scale * gap), turned_lever = coasted_[b] * lever;
      pose.position = state.body_poses[a].position + turned_arm - turned_lever;
      now_[b] = now_[a] + parent_angular.cross(turned_arm) + coasted_[a] * gap - angular.cross(turned_lever);
    }
    tangent_.segment<3>(translation(body)) = now_[b];
    tangent_.segment<3>(rotation(body)) = angular;
  }
  if (node_bodies_.empty()) {
    state.node_positions += scale * Eigen::Map<const Eigen::Matrix3Xd>(increment.data(), 3, layout_.node_count);
    tangent_.head(3 * layout_.node_count) = increment.head(3 * layout_.node_count);
    return;
  }
  for (std::size_t n = 0; n < node_bodies_.size(); ++n) {
    const auto b = static_cast<std::size_t>(node_bodies_[n]);
    const auto column = static_cast<Eigen::Index>(n);
    const Vector3 whole = increment.segment<3>(3 * column);
    if (is_loose(n) || is_straight_[b]) {
      state.node_positions.col(column) += scale * whole;
      tangent_.segment<3>(3 * column) = whole;
      continue;
    }
    const Vector3 angular = increment.segment<3>(rotation(node_bodies_[n]));
    const Vector3 arm = state.node_positions.col(column) - then_[b];
    const Vector3 own = whole - increment.segment<3>(translation(node_bodies_[n])) - angular.cross(arm);
    const Vector3 turned = coasted_[b] * (arm + scale * own);
    state.node_positions.col(column) = state.body_poses[b].position + turned;
    tangent_.segment<3>(3 * column) = now_[b] + angular.cross(turned) + coasted_[b] * own;
  }
}

double Linkage::prediction_error(const State& start, const State& state, double time_step) const {
  double squares = 0;
  for (std::size_t b = 0; b < links_.size(); ++b) {
    squares +=
        (state.body_poses[b].position - start.body_poses[b].position - time_step * start.body_velocities[b].linear)
            .squaredNorm();
  }
  return links_.empty() ? 0.0 : std::sqrt(squares / static_cast<double>(links_.size()));
}

void Linkage::set_earlier_state(const State& state) {
  for (std::size_t b = 0; b < earlier_orientations_.size(); ++b)
    earlier_orientations_[b] = state.body_poses[b].orientation;
  for (std::size_t b = 0; b < links_.size(); ++b) levers_[b] = earlier_orientations_[b] * links_[b].joint;
}

void Linkage::set_later_state(const State& state) {
  for (std::size_t b = 0; b < earlier_orientations_.size(); ++b)
    turns_[b] = (state.body_poses[b].orientation * earlier_orientations_[b].conjugate()).toRotationMatrix();
}

double Linkage::root_mean_square(const VectorX& increment) const {
  double nodes = 0, bodies = 0;
  if (layout_.node_count > 0) nodes = increment.head(3 * layout_.node_count).squaredNorm() / layout_.node_count;
  for (int body = 0; body < linked_bodies(); ++body)
    bodies += increment.segment<3>(translation(body)).squaredNorm() / linked_bodies();
  return std::sqrt(std::max(nodes, bodies));
}

double Linkage::largest_move(const VectorX& increment) const {
  double nodes = 0, bodies = 0;
  if (layout_.node_count > 0)
    nodes =
        Eigen::Map<const Eigen::Matrix3Xd>(increment.data(), 3, layout_.node_count).colwise().squaredNorm().maxCoeff();
  for (int body = 0; body < linked_bodies(); ++body)
    bodies = std::max(bodies, increment.segment<3>(translation(body)).squaredNorm());
  return std::sqrt(std::max(nodes, bodies));
}

void Linkage::coast(State& state, double time_step) {
  for (std::size_t b = 0; b < links_.size(); ++b) {
    const Twist& velocity = state.body_velocities[b];
    then_[b] = state.body_poses[b].position;
    coasted_[b] = rotation_exp(time_step * velocity.angular).toRotationMatrix();
    state.body_poses[b] = increment(state.body_poses[b], time_step * velocity.linear, time_step * velocity.angular);
  }
  for (std::size_t n = 0; n < node_bodies_.size(); ++n) {
    const auto b = static_cast<std::size_t>(node_bodies_[n]);
    const auto column = static_cast<Eigen::Index>(n);
    if (is_loose(n) || b >= links_.size()) {
      state.node_positions.col(column) += time_step * state.node_velocities.col(column);
      continue;
    }
    const Twist& velocity = state.body_velocities[b];
    const Vector3 arm = state.node_positions.col(column) - then_[b];
    const Vector3 own = state.node_velocities.col(column) - velocity.linear - velocity.angular.cross(arm);
    state.node_positions.col(column) = state.body_poses[b].position + coasted_[b] * (arm + time_step * own);
  }
}

void Linkage::to_bodies(const State& state, VectorX& gradient) const {
  for (std::size_t n = 0; n < node_bodies_.size(); ++n) {
    if (is_loose(n)) continue;
    auto row = gradient.segment<3>(static_cast<Eigen::Index>(3 * n));
    row = state.body_poses[static_cast<std::size_t>(node_bodies_[n])].orientation.conjugate() * Vector3(row);
  }
}

void Linkage::to_world(const State& state, VectorX& gradient) const {
  for (std::size_t n = 0; n < node_bodies_.size(); ++n) {
    if (is_loose(n)) continue;
    auto row = gradient.segment<3>(static_cast<Eigen::Index>(3 * n));
    row = state.body_poses[static_cast<std::size_t>(node_bodies_[n])].orientation * Vector3(row);
  }
}

void Linkage::to_now(VectorX& increment) {
  for (int body = 0; body < layout_.body_count; ++body) {
    const auto b = static_cast<std::size_t>(body);
    const Matrix3& turn = turns_[b];
    then_[b] = increment.segment<3>(translation(body));
    const Vector3 rotated = increment.segment<3>(rotation(body));
    const int parent = b < links_.size() ? links_[b].parent : -1;
    if (parent < 0) {
      now_[b] = turn * then_[b];
    } else {
      const auto a = static_cast<std::size_t>(parent);
      now_[b] = now_[a] + turns_[a] * (then_[b] - then_[a]) + (turns_[a] - turn) * rotated.cross(levers_[b]);
    }
    increment.segment<3>(translation(body)) = now_[b];
    increment.segment<3>(rotation(body)) = turn * rotated;
  }
  for (std::size_t n = 0; n < node_bodies_.size(); ++n) {
    if (is_loose(n)) continue;
    const auto b = static_cast<std::size_t>(node_bodies_[n]);
    const auto first = static_cast<Eigen::Index>(3 * n);
    increment.segment<3>(first) = Vector3(now_[b] + turns_[b] * (increment.segment<3>(first) - then_[b]));
  }
}

void Linkage::to_then(VectorX& gradient) {
  for (int body = 0; body < layout_.body_count; ++body) {
    const auto b = static_cast<std::size_t>(body);
    now_[b] = gradient.segment<3>(translation(body));
    then_[b].setZero();
  }
  for (std::size_t n = 0; n < node_bodies_.size(); ++n) {
    if (is_loose(n)) continue;
    const auto b = static_cast<std::size_t>(node_bodies_[n]);
    const auto first = static_cast<Eigen::Index>(3 * n);
    const Vector3 now = gradient.segment<3>(first);
    const Vector3 then = turns_[b].transpose() * now;
    now_[b] += now;
    then_[b] -= then;
    gradient.segment<3>(first) = then;
  }
  for (int body = layout_.body_count; body-- > 0;) {
    const auto b = static_cast<std::size_t>(body);
    const Matrix3& turn = turns_[b];
    Vector3 rotated = turn.transpose() * gradient.segment<3>(rotation(body));
    const int parent = b < links_.size() ? links_[b].parent : -1;
    if (parent < 0) {
      then_[b] += turn.transpose() * now_[b];
    } else {
      const auto a = static_cast<std::size_t>(parent);
      const Vector3 turned = turns_[a].transpose() * now_[b];
      now_[a] += now_[b];
      then_[a] -= turned;
      then_[b] += turned;
      rotated += levers_[b].cross((turns_[a] - turn).transpose() * now_[b]);
    }
    gradient.segment<3>(rotation(body)) = rotated;
  }
  // The sum of a parent is complete only after all its children have added their parts.
  for (int body = 0; body < layout_.body_count; ++body)
    gradient.segment<3>(translation(body)) = then_[static_cast<std::size_t>(body)];
}

}  // namespace softhand
