// The example of docs/add-an-energy.md: a spring whose anchor follows the node.
//
//   U = 1/2 k |x - a|^2
//
// Degrees of freedom: one node. Units: J, m, N/m. At the end of a step the anchor a follows the node. So the spring is
// never longer than `length`.
#pragma once

#include "energies/memory.hpp"

namespace softhand {

class Leash final : public EnergyWithMemory<Leash> {
 public:
  Leash(int node, double stiffness, double length) : node_(node), stiffness_(stiffness), length_(length) {}

  struct Memory {
    bool placed = false;               // the anchor is valid
    Vector3 anchor = Vector3::Zero();  // world
  };
  const Memory& save() const { return memory_; }
  void load(const Memory& memory) { memory_ = memory; }
  void reset() { memory_ = {}; }

  std::string_view name() const override { return "leash"; }
  void add_pattern(BlockPattern&) const override {}  // the diagonal is always there
  void bind(const BlockMatrix& matrix) override { diagonal_ = matrix.find(node_, node_); }
  void begin_step(const State& state, double) override {
    anchor_ = memory_.placed ? memory_.anchor : Vector3(state.node_positions.col(node_));
  }
  double value(const State& state) const override { return 0.5 * stiffness_ * stretch(state).squaredNorm(); }
  double add_gradient(const State& state, VectorX& gradient) const override {
    gradient.segment<3>(3 * node_) += stiffness_ * stretch(state);
    return value(state);
  }
  void add_hessian(const State&, BlockMatrix& hessian, Curvature) const override {
    hessian.add(diagonal_, stiffness_ * Matrix3::Identity());
  }
  void end_step(State& state) override {
    const double length = stretch(state).norm();
    if (length > length_) anchor_ += (1 - length_ / length) * stretch(state);
    memory_ = {true, anchor_};
  }

 private:
  Vector3 stretch(const State& state) const { return state.node_positions.col(node_) - anchor_; }

  int node_;
  double stiffness_, length_;
  BlockSlot diagonal_;
  Vector3 anchor_ = Vector3::Zero();  // fixed within the step
  Memory memory_;
};

}  // namespace softhand
