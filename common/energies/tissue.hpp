// Tissue: linear tetrahedra of co-rotational, strain-limited material (ES2725128A1 eqs. 21-30).
//
//   U_t = sum over tetrahedra V W(F),  F = D_s D_m^-1 = sum_a x_a b_a^T,  b_a the rest gradient of node a's shape
//   function
//
// W and its derivatives: corotational.hpp. Degrees of freedom: the nodes. Assumption: node n of the hand is node n of
// the state. The integral runs over the reference volume (eq. 21). The four gradients b_a sum to zero, so six 3x3
// blocks of the element's Hessian give the other four.
//
// Elements are evaluated side by side (tissue_kernel.hpp), with the same bits for every instruction set, for one thread
// and two, and on each run: a plane cuts the hand into two halves that share no node, and between them lie the elements
// that it crosses. The sum is over one half, the other and these, each in the order of the hand's file. The nodes of an
// element are sorted, so that its ten blocks lie in the lower triangle and none is transposed on scatter; F does not
// depend on the order.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "energies/corotational.hpp"
#include "energies/energy.hpp"
#include "energies/tissue_kernel.hpp"
#include "math/helper_thread.hpp"
#include "model/hand_model.hpp"

namespace softhand {

class Tissue final : public Energy {
 public:
  /// Uses nodes, tetrahedra, their materials. std::invalid_argument, naming the element, where a tetrahedron has no
  /// volume or a node, material or constant is out of range. `set` must be supported by the processor.
  explicit Tissue(const HandModel& hand, InstructionSet set = widest_instruction_set());
  /// From here on `add_all` computes the Hessian's axes and products in float: for a solver that factorises it in
  /// float. Energy and gradient stay what they are.
  void use_single_hessian() { single_hessian_ = true; }
  /// Takes the second half of the elements from here on; it outlives this.
  void use(HelperThread& helper) { helper_ = &helper; }

  int element_count() const { return element_count_; }
  /// Energies, gradients or Hessians of a tetrahedron, in any combination at one state, since construction.
  std::uint64_t evaluated_elements() const { return evaluated_elements_; }
  /// Tetrahedra with det F < 0.
  int inverted_elements(const State& state) const;
  /// Whether it is inside out and holds more than its mirror image would (`flip_density`).
  bool is_folded(const State& state, int element) const;
  /// W, J/m^3 of reference volume.
  double energy_density(const State& state, int element) const;
  double energy(const State& state, int element) const;  ///< J
  /// sqrt(3/2) times the norm of the deviator of the principal first Piola-Kirchhoff stresses, Pa: von Mises' measure
  /// for small stretch.
  double von_mises_stress(const State& state, int element) const;

  std::string_view name() const override { return "tissue"; }
  bool is_potential() const override { return true; }
  void add_pattern(BlockPattern& pattern) const override;
  void bind(const BlockMatrix& matrix) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  double add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const override;

 private:
  double evaluate(const State& state, const TissueOutput& output) const;
  Matrix3 deformation_gradient(const State& state, int element) const;
  CorotationalMaterial material(int element) const;

  struct Place {
    std::size_t batch, lane;
  };
  Place place_of(int element) const;

  TissueKernel kernel_;
  HelperThread* helper_ = nullptr;
  bool single_hessian_ = false;
  int element_count_ = 0;
  std::vector<std::array<std::int32_t, 4>>
      corners_;  // the nodes of an element, in an order that makes its volume positive at rest
  mutable std::uint64_t evaluated_elements_ = 0;
  std::vector<TissueBatch> batches_;    // of one half, of the other, of what lies between
  std::array<std::size_t, 4> group_{};  // where these begin and end
  std::vector<std::int32_t> position_;  // of an element: kTissueBatch times its batch, and its lane
};

}  // namespace softhand
