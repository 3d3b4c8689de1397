#include "model/state.hpp"

#include "math/rotation.hpp"

namespace softhand {

State empty_state(DofLayout layout) {
  State state;
  state.node_positions = state.node_velocities = Eigen::Matrix3Xd::Zero(3, layout.node_count);
  state.body_poses.resize(static_cast<std::size_t>(layout.body_count));
  state.body_velocities.resize(static_cast<std::size_t>(layout.body_count));
  return state;
}

void apply_increment(State& state, const VectorX& direction, double scale) {
  const DofLayout layout = state.layout();
  state.node_positions += scale * Eigen::Map<const Eigen::Matrix3Xd>(direction.data(), 3, layout.node_count);
  for (int body = 0; body < layout.body_count; ++body) {
    Pose& pose = state.body_poses[static_cast<std::size_t>(body)];
    const auto delta = direction.segment<6>(3 * layout.body_translation_block(body));
    pose = increment(pose, scale * delta.head<3>(), scale * delta.tail<3>());
  }
}

double inner_product(DofLayout layout, const VectorX& a, const VectorX& b) {
  // Vectorised sums depend on the length of the vectors.
  const Eigen::Index core = layout.dof_count() - 3 * layout.border_count();
  double sum = a.head(core).dot(b.head(core));
  for (Eigen::Index i = core; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

bool all_finite(const State& state) {
  if (!state.node_positions.allFinite() || !state.node_velocities.allFinite()) return false;
  for (const Pose& pose : state.body_poses) {
    if (!pose.position.allFinite() || !pose.orientation.coeffs().allFinite()) return false;
  }
  for (const Twist& twist : state.body_velocities) {
    if (!twist.linear.allFinite() || !twist.angular.allFinite()) return false;
  }
  return true;
}

}  // namespace softhand
