#include "energies/node_coupling.hpp"

#include <cmath>
#include <numeric>

namespace softhand {

NodeCoupling::NodeCoupling(int first_node, const std::vector<double>& masses, double stiffness, double damping_ratio)
    : first_(first_node), shares_(masses), stiffness_(stiffness) {
  const double mass = std::accumulate(masses.begin(), masses.end(), 0.0);
  for (double& share : shares_) share /= mass;
  damping_ = 2 * damping_ratio * std::sqrt(stiffness * mass);
  target_ = target_velocity_ = damped_ = Eigen::Matrix3Xd::Zero(3, static_cast<Eigen::Index>(shares_.size()));
}

void NodeCoupling::set_target(const Eigen::Ref<const Eigen::Matrix3Xd>& positions,
                              const Eigen::Ref<const Eigen::Matrix3Xd>& velocities) {
  target_ = positions;
  target_velocity_ = velocities;
  is_on_ = true;
}

void NodeCoupling::bind(const BlockMatrix& matrix) {
  diagonal_.clear();
  for (std::size_t n = 0; n < shares_.size(); ++n) {
    const int block = static_cast<int>(first_) + static_cast<int>(n);
    diagonal_.push_back(matrix.find(block, block));
  }
}

void NodeCoupling::begin_step(const State& state, double time_step) {
  time_step_ = time_step;
  damped_ = state.node_positions.middleCols(first_, damped_.cols()) + time_step * target_velocity_;
}

double NodeCoupling::evaluate(const State& state, double* gradient) const {
  if (!is_on_) return 0;
  const double damping = damping_ / time_step_;
  double twice = 0;
  for (std::size_t n = 0; n < shares_.size(); ++n) {
    const auto column = static_cast<Eigen::Index>(n);
    const Vector3 stretch = state.node_positions.col(first_ + column) - target_.col(column);
    const Vector3 drift = state.node_positions.col(first_ + column) - damped_.col(column);
    twice += shares_[n] * (stiffness_ * stretch.squaredNorm() + damping * drift.squaredNorm());
    if (gradient != nullptr)
      Eigen::Map<Vector3>(gradient + 3 * (first_ + column)) += shares_[n] * (stiffness_ * stretch + damping * drift);
  }
  return 0.5 * twice;
}

double NodeCoupling::value(const State& state) const { return evaluate(state, nullptr); }

double NodeCoupling::add_gradient(const State& state, VectorX& gradient) const {
  return evaluate(state, gradient.data());
}

void NodeCoupling::add_hessian(const State&, BlockMatrix& hessian, Curvature) const {
  if (!is_on_) return;
  for (std::size_t n = 0; n < shares_.size(); ++n)
    hessian.add(diagonal_[n], shares_[n] * (stiffness_ + damping_ / time_step_) * Matrix3::Identity());
}

void NodeCoupling::end_step(State& state) {
  stored_before_ = memory_.stored;
  memory_.stored = heat_ = 0;
  if (!is_on_) return;
  for (std::size_t n = 0; n < shares_.size(); ++n) {
    const auto column = static_cast<Eigen::Index>(n);
    const Vector3 at = state.node_positions.col(first_ + column);
    memory_.stored += 0.5 * shares_[n] * stiffness_ * (at - target_.col(column)).squaredNorm();
    heat_ += shares_[n] * damping_ / time_step_ * (at - damped_.col(column)).squaredNorm();
  }
}

EnergyFlow NodeCoupling::flow(double, double, double taken) const {
  return {.stored = memory_.stored, .work = memory_.stored - stored_before_ + heat_ - taken, .damping = heat_};
}

}  // namespace softhand
