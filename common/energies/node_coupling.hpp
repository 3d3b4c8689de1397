// Spring and damper between each node of a flexible object and its copy in another process: U'_crb of ES2725128A1
// (claim 8, "coupled node to node"), with damping. Mode symmetric of docs/soft-objects.md.
//
//   U = sum over nodes of k w/2 |x - x_c|^2 + d w/(2 dt) |x - x_0 - dt v_c|^2,   w = m_i/m,  d = 2 zeta sqrt(k m)
//
// x_c and v_c: the newest state of the copy's node. x_0: the node at the start of the step. m: the object's mass. So k
// and d are those of the whole object, and each node has the frequency of the whole object.
//
// Degrees of freedom: the nodes of the object. Units: J, m, kg, N/m.
#pragma once

#include <string_view>
#include <vector>

#include "energies/memory.hpp"

namespace softhand {

class NodeCoupling final : public EnergyWithMemory<NodeCoupling> {
 public:
  /// `masses`: of the nodes `first_node` and so on, kg, > 0. `stiffness` k in N/m, >= 0. `damping_ratio` zeta, >= 0. It
  /// is off until `set_target`.
  NodeCoupling(int first_node, const std::vector<double>& masses, double stiffness, double damping_ratio);

  /// The copy in the next steps. `positions` (m) and `velocities` (m/s), world axes, have a column for each node of the
  /// object.
  void set_target(const Eigen::Ref<const Eigen::Matrix3Xd>& positions,
                  const Eigen::Ref<const Eigen::Matrix3Xd>& velocities);
  void clear_target() { is_on_ = false; }

  /// All that a step carries to the next one, for the ledger.
  struct Memory {
    double stored = 0;  // J, in the springs after the last step
  };
  const Memory& save() const { return memory_; }
  void load(const Memory& memory) { memory_ = memory; }
  void reset() { memory_ = {}; }

  std::string_view name() const override { return "node_coupling"; }
  void add_pattern(BlockPattern&) const override {}  // the diagonal is always there
  void bind(const BlockMatrix& matrix) override;
  void begin_step(const State& state, double time_step) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  void end_step(State& state) override;
  /// Stored: the springs. Damping: the dampers. The rest is the work of the copy.
  EnergyFlow flow(double start, double end, double taken) const override;

 private:
  double evaluate(const State& state, double* gradient) const;

  Eigen::Index first_;
  std::vector<double> shares_;  // w
  double stiffness_, damping_;
  bool is_on_ = false;
  Eigen::Matrix3Xd target_, target_velocity_;
  // Of this step.
  double time_step_ = 0;
  double stored_before_ = 0, heat_ = 0;  // J
  Eigen::Matrix3Xd damped_;              // x_0 + dt v_c
  Memory memory_;
  std::vector<BlockSlot> diagonal_;
};

}  // namespace softhand
