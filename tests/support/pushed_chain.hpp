// Springs, walls and a chain of nodes that walls push, for tests of solves of contact.
#pragma once

#include <algorithm>
#include <vector>

#include "energies/energy.hpp"
#include "math/block_matrix.hpp"
#include "model/state.hpp"

namespace softhand::testing {

/// A quadratic term 1/2 k |x_a - x_b|^2 between two nodes, or between a node and the origin.
class Spring final : public Energy {
 public:
  Spring(int a, int b, double stiffness) : a_(a), b_(b), stiffness_(stiffness) {}
  std::string_view name() const override { return "spring"; }
  void add_pattern(BlockPattern& pattern) const override {
    pattern.add(a_, a_);
    if (b_ < 0) return;
    pattern.add(b_, b_);
    pattern.add(a_, b_);
  }
  void bind(const BlockMatrix& matrix) override {
    aa_ = matrix.find(a_, a_);
    if (b_ < 0) return;
    bb_ = matrix.find(b_, b_);
    ab_ = matrix.find(a_, b_);
  }
  double value(const State& state) const override { return 0.5 * stiffness_ * stretch(state).squaredNorm(); }
  double add_gradient(const State& state, VectorX& gradient) const override {
    const Vector3 force = stiffness_ * stretch(state);
    gradient.segment<3>(3 * a_) += force;
    if (b_ >= 0) gradient.segment<3>(3 * b_) -= force;
    return value(state);
  }
  void add_hessian(const State&, BlockMatrix& hessian, Curvature) const override {
    const Matrix3 block = stiffness_ * Matrix3::Identity();
    hessian.add(aa_, block);
    if (b_ < 0) return;
    hessian.add(bb_, block);
    hessian.add(ab_, -block);
  }

 private:
  Vector3 stretch(const State& state) const {
    return b_ < 0 ? Vector3(state.node_positions.col(a_))
                  : Vector3(state.node_positions.col(a_) - state.node_positions.col(b_));
  }
  int a_, b_;
  double stiffness_;
  BlockSlot aa_, bb_, ab_;
};

/// One-sided: 1/2 k min(0, x - offset)^2 along x of one node. Its curvature jumps where it begins to act.
class Wall final : public Energy {
 public:
  Wall(int node, double offset, double stiffness) : node_(node), offset_(offset), stiffness_(stiffness) {}
  std::string_view name() const override { return "wall"; }
  bool has_kinks() const override { return true; }
  void add_pattern(BlockPattern& pattern) const override { pattern.add(node_, node_); }
  void bind(const BlockMatrix& matrix) override { slot_ = matrix.find(node_, node_); }
  double value(const State& state) const override { return 0.5 * stiffness_ * depth(state) * depth(state); }
  double add_gradient(const State& state, VectorX& gradient) const override {
    gradient[3 * node_] += stiffness_ * depth(state);
    return value(state);
  }
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature) const override {
    if (depth(state) == 0) return;
    Matrix3 block = Matrix3::Zero();
    block(0, 0) = stiffness_;
    hessian.add(slot_, block);
  }

 private:
  double depth(const State& state) const { return std::min(0.0, state.node_positions(0, node_) - offset_); }
  int node_;
  double offset_, stiffness_;
  BlockSlot slot_;
};

/// A chain of four nodes: 0 is tied to the origin, and walls push nodes 2 and 3.
struct PushedChain {
  PushedChain() {
    state.node_positions = state.node_velocities = Eigen::Matrix3Xd::Zero(3, 4);
    for (int n = 0; n < 4; ++n) state.node_positions(0, n) = 0.01 * n - 0.02;
    BlockPattern pattern(4);
    for (Energy* term : all()) term->add_pattern(pattern);
    hessian = BlockMatrix(pattern);
    for (Energy* term : all()) term->bind(hessian);
  }
  std::vector<Energy*> all() { return {&tie, &first, &second, &third, &near, &far}; }
  std::vector<Energy*> walls() { return {&near, &far}; }
  VectorX gradient_at(const State& at) {
    VectorX gradient = VectorX::Zero(12);
    for (Energy* term : all()) term->add_gradient(at, gradient);
    return gradient;
  }
  Spring tie{0, -1, 100}, first{0, 1, 100}, second{1, 2, 100}, third{2, 3, 100};
  Wall near{2, 0.005, 1e4}, far{3, 0.02, 1e4};
  State state;
  BlockMatrix hessian;
};

}  // namespace softhand::testing
