// Relaxation of the tissue: Prony branches beside the elastic law. Not in the source, whose tissue answers at once.
//
//   U_r = sum over tetrahedra and branches V mu w/g |e^-a h + g (E - E_0)|^2
//   E = (F^T F - 1)/2,   a = dt/tau,   g = (1 - e^-a)/a
//
// A branch is a spring in series with a damper (Maxwell). Its shear modulus is mu w. h is the strain of the spring at
// the step's start, and E_0 the strain of the tetrahedron then. If E changes evenly over the step, then
// dh/dt = dE/dt - h/tau has the solution h' = e^-a h + g (E - E_0). dU_r/dE = 2 V mu w h' is its stress at the step's
// end. So a ramp has no error of time integration, for any dt/tau. Source: Simo and Hughes 1998, Computational
// Inelasticity, section 10.3. mu is the shear modulus of the tissue, which is the modulus after all branches relaxed.
//
// Only shear and length relax: the branches have no bulk modulus. Green's strain makes U_r invariant under rotations,
// so force and torque balance exactly. All branches together are one quadratic function of E within a step. So their
// number does not change the cost of an iteration. Elements are evaluated in parallel lanes (relaxation_kernel.hpp),
// with the same bits for every instruction set.
//
// Projected Hessian: without the curvature of E (Gauss-Newton), a sum of squares. Degrees of freedom: the nodes.
// Units: J, m, Pa, s.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "energies/memory.hpp"
#include "energies/relaxation_kernel.hpp"
#include "model/tissue_model.hpp"

namespace softhand {

class RelaxationEnergy final : public EnergyWithMemory<RelaxationEnergy> {
 public:
  using Branches = std::array<double, kRelaxationBranches>;
  /// Node n of the hand is node n of the state. `time_constants` in s, > 0. `weights[m]`: w of material m of the hand,
  /// >= 0. Tetrahedra whose weights are all zero have no branches and cost nothing. Throws std::invalid_argument if a
  /// number is out of range, or if the count of weights is not that of the materials. The processor must support `set`.
  RelaxationEnergy(const TissueModel& hand, const Branches& time_constants, const std::vector<Branches>& weights,
                   InstructionSet set = widest_instruction_set());
  /// From now on `add_all` computes the products of the Hessian in float, for a solver that factorises in float.
  void use_single_hessian() { single_hessian_ = true; }

  int element_count() const { return element_count_; }
  /// Heat of the dampers since construction or reset, J.
  double dissipated() const { return memory_.dissipated; }

  struct Memory {
    std::vector<double> springs;  // h, batch by batch
    double stored = 0;            // J, after the last step
    double dissipated = 0;        // J
  };
  const Memory& save() const { return memory_; }
  void load(const Memory& memory);
  /// The springs are relaxed.
  void reset();

  std::string_view name() const override { return "relaxation"; }
  int needed_bodies() const override { return 0; }
  void add_pattern(BlockPattern& pattern) const override;
  void bind(const BlockMatrix& matrix) override;
  void begin_step(const State& state, double time_step) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  double add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const override;
  void end_step(State& state) override;
  /// Stored: the springs. Damping: the heat of the dampers, for a strain that changes evenly within the step.
  EnergyFlow flow(double start, double end, double taken) const override;

 private:
  double evaluate(const State& state, const ElementOutput& output) const;

  RelaxationKernel kernel_;
  bool single_hessian_ = false;
  Branches time_constants_{};
  int element_count_ = 0;
  std::vector<RelaxationBatch> batches_;
  RelaxationDecay decay_[kRelaxationBranches];
  // The batches hold the function of a step that begins at these positions and lasts this long, s. 0: of no step. The
  // end of a step sets that of the next one, because it knows the strain.
  double begun_time_step_ = 0;
  Eigen::Matrix3Xd begun_positions_;
  Memory memory_;
  double before_ = 0;  // J, stored after the step before the last
  double heat_ = 0;    // J, of the last step
};

}  // namespace softhand
