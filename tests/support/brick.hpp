// A small soft body with known minima, and terms that are difficult for a solver. For the tests of NewtonSolver.
#pragma once

#include <array>
#include <cmath>
#include <cstring>
#include <utility>
#include <vector>

#include "energies/inertia.hpp"
#include "energies/tissue.hpp"
#include "solver/newton_solver.hpp"
#include "support/box_mesh.hpp"

namespace softhand::testing {

/// 1/2 k |x - anchor|^2 on all or some nodes, optionally with a quartic term. For tests with known results.
class Anchors final : public Energy {
 public:
  Anchors(std::vector<int> nodes, double stiffness, Eigen::Matrix3Xd targets, double quartic = 0)
      : nodes_(std::move(nodes)), stiffness_(stiffness), quartic_(quartic), targets_(std::move(targets)) {}
  std::string_view name() const override { return "anchors"; }
  void add_pattern(BlockPattern&) const override {}
  void bind(const BlockMatrix& matrix) override {
    slots_.clear();
    for (const int n : nodes_) slots_.push_back(matrix.find(n, n));
  }
  double value(const State& state) const override {
    double sum = 0;
    for (const int n : nodes_) {
      const double d = (state.node_positions.col(n) - targets_.col(n)).squaredNorm();
      sum += 0.5 * stiffness_ * d + 0.25 * quartic_ * d * d;
    }
    return sum;
  }
  double add_gradient(const State& state, VectorX& gradient) const override {
    for (const int n : nodes_) {
      const Vector3 d = state.node_positions.col(n) - targets_.col(n);
      gradient.segment<3>(3 * n) += (stiffness_ + quartic_ * d.squaredNorm()) * d;
    }
    return value(state);
  }
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature) const override {
    for (std::size_t k = 0; k < nodes_.size(); ++k) {
      const Vector3 d = state.node_positions.col(nodes_[k]) - targets_.col(nodes_[k]);
      hessian.add(slots_[k],
                  (stiffness_ + quartic_ * d.squaredNorm()) * Matrix3::Identity() + 2 * quartic_ * d * d.transpose());
    }
  }

 private:
  std::vector<int> nodes_;
  double stiffness_, quartic_;
  Eigen::Matrix3Xd targets_;
  std::vector<BlockSlot> slots_;
};

/// Adds a constant diagonal to the Hessian, or a bad entry such as NaN to the gradient. A solver must survive both.
class FaultyTerm final : public Energy {
 public:
  double curvature = 0;
  double gradient_entry = 0;
  std::string_view name() const override { return "saboteur"; }
  void add_pattern(BlockPattern&) const override {}
  void bind(const BlockMatrix& matrix) override { slot_ = matrix.find(0, 0); }
  double value(const State&) const override { return 0; }
  double add_gradient(const State&, VectorX& gradient) const override {
    gradient[0] += gradient_entry;
    return 0;
  }
  void add_hessian(const State&, BlockMatrix& hessian, Curvature) const override {
    hessian.add(slot_, curvature * Matrix3::Identity());
  }

 private:
  BlockSlot slot_;
};

inline Material soft(double nu = 0.45, double youngs_modulus = 1e5) {
  return {"skin", 1000, youngs_modulus, nu, 500, 500};
}

inline std::vector<int> nodes_at(const HandModel& box, int axis, double coordinate) {
  std::vector<int> found;
  for (int n = 0; n < box.node_count(); ++n) {
    if (std::abs(box.nodes[static_cast<std::size_t>(n)][axis] - coordinate) < 1e-9) found.push_back(n);
  }
  return found;
}

inline std::vector<int> bone_nodes(const HandModel& box) {
  std::vector<int> nodes = nodes_at(box, 0, 0);
  for (const int n : nodes_at(box, 1, 0.01)) {
    const Vector3& x = box.nodes[static_cast<std::size_t>(n)];
    if (std::abs(x.z() - 0.01) < 1e-9 && x.x() > 0) nodes.push_back(n);
  }
  return nodes;
}

inline SolverOptions converging(std::int64_t iterations = 100) {
  SolverOptions options;
  options.max_iterations = iterations;
  options.keep_factor = false;
  options.residual_tolerance = 1e-9;
  options.increment_tolerance = 1e-13;
  return options;
}

inline bool same_bits(const Eigen::Matrix3Xd& a, const Eigen::Matrix3Xd& b) {
  return a.size() == b.size() &&
         std::memcmp(a.data(), b.data(), sizeof(double) * static_cast<std::size_t>(a.size())) == 0;
}

// A brick of tissue around a bone: held at one end and along its middle.
struct Brick {
  HandModel box;
  State state;
  Tissue tissue;
  Inertia inertia;
  Anchors anchors;

  explicit Brick(std::array<int, 3> cells = {3, 2, 2}, const Material& material = soft())
      : box(box_mesh(cells, Vector3(0.03, 0.02, 0.02), material)),
        state(rest_state(box)),
        tissue(box),
        inertia(lumped_masses(box), 0),
        anchors(bone_nodes(box), 1e4, state.node_positions) {}
  std::vector<Energy*> terms() { return {&inertia, &tissue, &anchors}; }
  void shake(double amount, std::uint64_t seed) {
    Random random(seed);
    for (int n = 0; n < box.node_count(); ++n) state.node_positions.col(n) += amount * random.vector();
  }
};

}  // namespace softhand::testing
