// Tissue: linear tetrahedra of co-rotational, strain-limited material (ES2725128A1 eqs. 21-30).
//
//   U_t = sum over tetrahedra V W(F),  F = D_s D_m^-1 = sum_a x_a b_a^T
//
// b_a is the rest gradient of the shape function of node a.
//
// corotational.hpp defines W and its derivatives. The degrees of freedom are the nodes. Assumption: node n of the model
// is node n of the state. The integral is over the reference volume (eq. 21). The four gradients b_a sum to zero, so
// six 3x3 blocks of the element's Hessian determine the other four.
//
// Tissue of materials that relax is a term of its own (relaxing_tissue.hpp).
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "energies/corotational.hpp"
#include "energies/energy.hpp"
#include "energies/relaxing_tissue.hpp"
#include "energies/tissue_elements.hpp"

namespace softhand {

class Tissue final : public Energy {
 public:
  /// Uses nodes, tetrahedra and their materials. Throws std::invalid_argument with the element's number if a
  /// tetrahedron has no volume, or if a node, material or constant is out of range. The processor must support `set`.
  /// `name`: of the term, a literal. `relaxation`: the energy leaves out the tetrahedra of materials that relax.
  explicit Tissue(const TissueModel& model, InstructionSet set = widest_instruction_set(),
                  std::string_view name = "tissue", const PronySeries& relaxation = {});
  /// From now on `add_all` computes the axes and products of the Hessian in float, for a solver that factorises in
  /// float. Energy and gradient do not change.
  void use_single_hessian() { elements_.use_single_hessian(); }
  /// From now on `helper` evaluates the second half of the elements. It must outlive this object.
  void use(HelperThread& helper) { elements_.use(helper); }

  /// While it is off, its energy is zero and nothing is evaluated. The solver must forget when this changes.
  void switch_on(bool on) { is_on_ = on; }
  /// See TissueElements::evaluated.
  std::uint64_t evaluated_elements() const { return elements_.evaluated(); }
  int element_count() const { return static_cast<int>(tetrahedra_.size()); }

  // By the elastic law, also of the tetrahedra that relax.

  /// Number of tetrahedra with det F < 0.
  int inverted_elements(const State& state) const;
  /// True if the element is inverted and has more energy than its mirror image would have (`flip_density`).
  bool is_folded(const State& state, int element) const;
  /// W, J/m^3 of reference volume.
  double energy_density(const State& state, int element) const;
  double energy(const State& state, int element) const;  ///< J
  /// sqrt(3/2) times the norm of the deviator of the principal first Piola-Kirchhoff stresses, Pa. For small stretch it
  /// equals the von Mises stress.
  double von_mises_stress(const State& state, int element) const;

  std::string_view name() const override { return name_; }
  bool is_potential() const override { return true; }
  int needed_bodies() const override { return 0; }
  void add_pattern(BlockPattern& pattern) const override { elements_.add_pattern(pattern); }
  void bind(const BlockMatrix& matrix) override { elements_.bind(matrix); }
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  double add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const override;
  Around add_around(std::span<const std::int32_t> nodes, const State& state, double* gradient,
                    double* blocks) const override;

 private:
  struct Tetrahedron {
    std::array<std::int32_t, 4> corners;  // ordered for a positive volume at rest
    CorotationalMaterial material;
    double volume;          // m^3
    Matrix3 inverse_edges;  // D_m^-1, 1/m
  };
  const Tetrahedron& at(int element) const { return tetrahedra_[static_cast<std::size_t>(element)]; }
  Matrix3 deformation_gradient(const State& state, int element) const;

  std::string_view name_;
  bool is_on_ = true;
  TissueElements elements_;
  std::vector<Tetrahedron> tetrahedra_;
};

}  // namespace softhand
