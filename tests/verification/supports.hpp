// Supports and loads of static known answers.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "energies/energy.hpp"
#include "solver/newton_solver.hpp"

namespace softhand::verification {

/// Energy of springs to fixed positions X: sum over the nodes of 1/2 (x - X)^T K (x - X), K in N/m. This is a wall.
/// With K = k n n^T it is a plane of symmetry.
class Supports final : public Energy {
 public:
  Supports(std::vector<int> nodes, const Matrix3& stiffness, Eigen::Matrix3Xd places)
      : nodes_(std::move(nodes)), stiffness_(stiffness), places_(std::move(places)) {}
  std::string_view name() const override { return "supports"; }
  void add_pattern(BlockPattern&) const override {}
  void bind(const BlockMatrix& matrix) override {
    slots_.clear();
    for (const int n : nodes_) slots_.push_back(matrix.find(n, n));
  }
  double value(const State& state) const override {
    double sum = 0;
    for (const int n : nodes_) {
      const Vector3 away = state.node_positions.col(n) - places_.col(n);
      sum += 0.5 * away.dot(stiffness_ * away);
    }
    return sum;
  }
  double add_gradient(const State& state, VectorX& gradient) const override {
    for (const int n : nodes_)
      gradient.segment<3>(3 * n) += stiffness_ * (state.node_positions.col(n) - places_.col(n));
    return value(state);
  }
  void add_hessian(const State&, BlockMatrix& hessian, Curvature) const override {
    for (const BlockSlot& slot : slots_) hessian.add(slot, stiffness_);
  }

 private:
  std::vector<int> nodes_;
  Matrix3 stiffness_;
  Eigen::Matrix3Xd places_;
  std::vector<BlockSlot> slots_;
};

/// Constant nodal forces, N.
class Load final : public Energy {
 public:
  explicit Load(Eigen::Matrix3Xd forces) : forces_(std::move(forces)) {}
  std::string_view name() const override { return "load"; }
  void add_pattern(BlockPattern&) const override {}
  void bind(const BlockMatrix&) override {}
  double value(const State& state) const override { return -forces_.cwiseProduct(state.node_positions).sum(); }
  double add_gradient(const State& state, VectorX& gradient) const override {
    gradient.head(forces_.size()) -= Eigen::Map<const VectorX>(forces_.data(), forces_.size());
    return value(state);
  }
  void add_hessian(const State&, BlockMatrix&, Curvature) const override {}

 private:
  Eigen::Matrix3Xd forces_;
};

inline constexpr double kRestStep = 1e4;  ///< s; so long that inertia has no effect

/// Brings the state to rest in one step. `force_scale` is the load, N. Throws std::runtime_error if Newton's method
/// does not converge.
inline void settle(NewtonSolver& solver, State& state, double force_scale) {
  const StepReport report = solver.step(state, kRestStep);
  if (report.residual > 1e-5 * force_scale) {
    throw std::runtime_error("the solver did not come to rest: residual " +
                             std::to_string(report.residual / force_scale) + " of the load after " +
                             std::to_string(report.iterations) + " iterations");
  }
  state.node_velocities.setZero();
}

}  // namespace softhand::verification
