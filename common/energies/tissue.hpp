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
// Elements are evaluated in parallel lanes (tissue_kernel.hpp). The result has the same bits for every instruction set,
// for one thread or two, and in each run. For this, a plane cuts the hand into two halves without common nodes. The
// elements that the plane crosses lie between the halves. The sum runs over the first half, the second half and the
// crossed elements, each in the order of the hand's file. The nodes of an element are sorted, so its ten blocks lie in
// the lower triangle and no block is transposed on scatter. F does not depend on the order of the nodes.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "energies/corotational.hpp"
#include "energies/energy.hpp"
#include "energies/tissue_kernel.hpp"
#include "math/helper_thread.hpp"
#include "model/tissue_model.hpp"

namespace softhand {

class Tissue final : public Energy {
 public:
  /// Uses nodes, tetrahedra and their materials. Throws std::invalid_argument with the element's number if a
  /// tetrahedron has no volume, or if a node, material or constant is out of range. The processor must support `set`.
  /// `name`: of the term, a literal.
  explicit Tissue(const TissueModel& model, InstructionSet set = widest_instruction_set(),
                  std::string_view name = "tissue");
  /// From now on `add_all` computes the axes and products of the Hessian in float, for a solver that factorises in
  /// float. Energy and gradient do not change.
  void use_single_hessian() { single_hessian_ = true; }
  /// From now on `helper` evaluates the second half of the elements. It must outlive this object.
  void use(HelperThread& helper) { helper_ = &helper; }

  int element_count() const { return element_count_; }
  /// While it is off, its energy is zero and nothing is evaluated. The solver must forget when this changes.
  void switch_on(bool on) { is_on_ = on; }
  /// Number of element evaluations since construction. One evaluation computes energy, gradient or Hessian of a
  /// tetrahedron at one state, in any combination.
  std::uint64_t evaluated_elements() const { return evaluated_elements_; }
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
  void add_pattern(BlockPattern& pattern) const override;
  void bind(const BlockMatrix& matrix) override;
  double value(const State& state) const override;
  double add_gradient(const State& state, VectorX& gradient) const override;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature) const override;
  double add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature) const override;
  Around add_around(std::span<const std::int32_t> nodes, const State& state, double* gradient,
                    double* blocks) const override;

 private:
  double evaluate(const State& state, const ElementOutput& output) const;
  Matrix3 deformation_gradient(const State& state, int element) const;
  CorotationalMaterial material(int element) const;

  struct Place {
    std::size_t batch, lane;
  };
  Place place_of(int element) const;

  std::string_view name_;
  TissueKernel kernel_;
  HelperThread* helper_ = nullptr;
  bool single_hessian_ = false;
  bool is_on_ = true;
  int element_count_ = 0;
  std::vector<std::array<std::int32_t, 4>> corners_;  // nodes per element, ordered for a positive volume at rest
  mutable std::uint64_t evaluated_elements_ = 0;
  std::vector<TissueBatch> batches_;    // of the first half, the second half and the crossed elements
  std::array<std::size_t, 4> group_{};  // begin and end of these three groups
  std::vector<std::int32_t> position_;  // per element: kElementBatch times its batch, plus its lane
  // The elements around each node: from `first_around_[node]` to `first_around_[node + 1]` in `around_`.
  std::vector<std::int32_t> first_around_, around_;
  // Scratch of `add_around`: per node its place (-1: it is fixed) and its gradient, per element whether it is in
  // `chosen_`, and a batch of them.
  mutable std::vector<std::int32_t> place_, chosen_;
  mutable std::vector<double> gradient_around_;
  mutable std::vector<std::uint8_t> is_chosen_;
  mutable TissueBatch batch_around_;
};

}  // namespace softhand
