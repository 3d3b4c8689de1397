// Tissue that relaxes: Prony branches beside the lasting stress. Not in the source, whose tissue answers at once.
//
//   S = S_e - sum over branches c d,   dd/dt = (S_e - d)/tau
//
// S_e = F^-1 dW/dF is the second Piola-Kirchhoff stress of the elastic law (corotational.hpp). d is its mean over the
// past, with the weight e^(-age/tau). So the elastic law is the instantaneous one. All of its stress relaxes, that of
// strain limiting too, and the share c_0 = 1 - sum c lasts. This is quasi-linear viscoelasticity (Fung 1993,
// Biomechanics, section 7.6), by which Pawluk and Howe (1999) describe the fingertip.
//
// If S_e changes evenly over a step of dt, d' = e^-a d + (1 - g) S_e' + (g - e^-a) S_e is exact, with a = dt/tau and
// g = (1 - e^-a)/a. Then the stress at the step's end is the derivative of an energy density:
//
//   U = gamma W(F) + A : E + const,   E = (F^T F - 1)/2
//   gamma = 1 - sum c (1 - g),   A = -sum c (e^-a d + (g - e^-a) S_e)
//
// So within a step the tissue has its own law with a factor, and a constant stress A in addition. The tissue's kernel
// computes both, and projects their Hessian (tissue_kernel_source.hpp).
// Green's strain E makes U invariant under rotations, so force and torque balance exactly.
//
// S_e is bounded for flat and inverted tissue, and for tissue with a sum of principal strains above 2 mu/lambda
// (relaxation_kernel_source.hpp). Such tissue relaxes by less.
//
// The sum over tetrahedra is their energy V U. Between two steps the law is the elastic one. Degrees of freedom: the
// nodes. Units: J, m, Pa, s.
#pragma once

#include <array>
#include <vector>

#include "energies/memory.hpp"
#include "energies/tissue_elements.hpp"

namespace softhand {

/// The branches of the materials of a hand.
struct PronySeries {
  using Branches = std::array<double, kRelaxationBranches>;
  Branches time_constants{};      ///< tau, s, > 0
  std::vector<Branches> weights;  ///< c by material, each >= 0, with a sum < 1; empty: nothing relaxes

  /// The tetrahedra of the model that relax, or those that do not, ascending.
  std::vector<std::size_t> tetrahedra(const TissueModel& model, bool relaxing) const;
};

class RelaxingTissue final : public EnergyWithMemory<RelaxingTissue> {
 public:
  /// The tetrahedra of the materials that relax. Node n of the model is node n of the state. Throws
  /// std::invalid_argument if a number of the series is out of range, or its materials are not those of the model, or
  /// as TissueElements. The processor must support `set`.
  RelaxingTissue(const TissueModel& model, const PronySeries& series, InstructionSet set = widest_instruction_set());
  /// See Tissue.
  void use_single_hessian() { elements_.use_single_hessian(); }
  void use(HelperThread& helper) { elements_.use(helper); }
  std::uint64_t evaluated_elements() const { return elements_.evaluated(); }

  int element_count() const { return static_cast<int>(elements_.count()); }

  struct Memory {
    std::vector<double> mean_stresses;  // d, Pa, batch by batch
    bool fresh = true;                  // no step yet: the first one finds the tissue strained at once
  };
  const Memory& save() const { return memory_; }
  void load(const Memory& memory);
  /// The tissue has been at rest until now.
  void reset();
  /// The same for the tetrahedra of nodes that were moved since the last step.
  void reset_moved(const State& state);

  std::string_view name() const override { return "relaxing_tissue"; }
  int needed_bodies() const override { return 0; }
  void add_pattern(BlockPattern& pattern) const override { elements_.add_pattern(pattern); }
  void bind(const BlockMatrix& matrix) override { elements_.bind(matrix); }
  void begin_step(const State& state, double time_step) override;
  double value(const State& state) const override { return elements_.value(state, step()); }
  double add_gradient(const State& state, VectorX& gradient) const override {
    return elements_.add_gradient(state, gradient, step());
  }
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override {
    elements_.add_hessian(state, hessian, curvature, step());
  }
  double add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const override {
    return elements_.add_all(state, gradient, hessian, curvature, step());
  }
  Around add_around(std::span<const std::int32_t> nodes, const State& state, double* gradient,
                    double* blocks) const override {
    return elements_.add_around(nodes, state, gradient, blocks, step());
  }
  void end_step(State& state) override;
  void cancel_step() override { in_step_ = false; }
  /// Stored: by the lasting stress. Damping: the work that the branches took, as functions of the step. A part of it is
  /// heat. They may give back the rest, which they hold. Work: what they hold in tissue that starts strained.
  EnergyFlow flow(double start, double end, double taken) const override;

 private:
  const RelaxationBatch* step() const { return in_step_ ? batches_.data() : nullptr; }

  PronySeries series_;
  TissueElements elements_;
  RelaxationKernel kernel_;
  std::vector<RelaxationBatch> batches_;
  RelaxationDecay decay_[kRelaxationBranches];
  bool in_step_ = false;
  // The batches hold the function of a step that begins at these positions and lasts this long, s. 0: of no step. The
  // end of a step sets that of the next one, because it knows the stress.
  double begun_time_step_ = 0;
  Eigen::Matrix3Xd begun_positions_;
  double stored_ = 0;  // J, by the lasting stress, at the end of the last step
  double put_in_ = 0;  // J, held by the branches at the start of the first step
  Memory memory_;
};

}  // namespace softhand
