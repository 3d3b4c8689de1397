// Tetrahedra of tissue in batches: what the terms of elastic and of relaxing tissue share.
//
// Elements are evaluated in parallel lanes (tissue_kernel.hpp). The result has the same bits for every instruction set,
// for one thread or two, and in each run. For this, a plane cuts the elements into two halves without common nodes. The
// elements that the plane crosses lie between the halves. The sum runs over the first half, the second half and the
// crossed elements, each in the order of the hand's file. The nodes of an element are sorted, so its ten blocks lie in
// the lower triangle and no block is transposed on scatter. F does not depend on the order of the nodes.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "energies/energy.hpp"
#include "energies/relaxation_kernel.hpp"
#include "math/helper_thread.hpp"
#include "model/tissue_model.hpp"

namespace softhand {

class TissueElements {
 public:
  /// `elements`: tetrahedra of the model, ascending. Throws std::invalid_argument with the element's number if a
  /// tetrahedron has no volume, or if a node, material or constant is out of range. The processor must support `set`.
  TissueElements(const TissueModel& model, const std::vector<std::size_t>& elements, InstructionSet set);
  /// From now on, gradient and Hessian together compute the axes and products of the Hessian in float.
  void use_single_hessian() { single_hessian_ = true; }
  /// From now on `helper` evaluates the second half of the elements. It must outlive this object.
  void use(HelperThread& helper) { helper_ = &helper; }

  std::size_t count() const { return position_.size(); }
  const std::vector<TissueBatch>& batches() const { return batches_; }
  /// The tetrahedron of each lane of the batches. The last one of a group is repeated to the end of its last batch.
  const std::vector<std::size_t>& order() const { return order_; }
  /// Number of element evaluations since construction. One evaluation computes energy, gradient or Hessian of a
  /// tetrahedron at one state, in any combination.
  std::uint64_t evaluated() const { return evaluated_; }

  void add_pattern(BlockPattern& pattern) const;
  void bind(const BlockMatrix& matrix);
  /// `relaxation`: one per batch, or null for the elastic law. Returns the energy, J.
  double value(const State& state, const RelaxationBatch* relaxation = nullptr) const;
  double add_gradient(const State& state, VectorX& gradient, const RelaxationBatch* relaxation = nullptr) const;
  void add_hessian(const State& state, BlockMatrix& hessian, Curvature curvature,
                   const RelaxationBatch* relaxation = nullptr) const;
  double add_all(const State& state, VectorX& gradient, BlockMatrix& hessian, Curvature curvature,
                 const RelaxationBatch* relaxation = nullptr) const;
  /// As Energy::add_around. The share is that of all tetrahedra of the model.
  Energy::Around add_around(std::span<const std::int32_t> nodes, const State& state, double* gradient, double* blocks,
                            const RelaxationBatch* relaxation = nullptr) const;

 private:
  double evaluate(const State& state, const ElementOutput& output, const RelaxationBatch* relaxation) const;

  TissueKernel kernel_;
  HelperThread* helper_ = nullptr;
  bool single_hessian_ = false;
  std::size_t all_elements_ = 0;  // of the model
  mutable std::uint64_t evaluated_ = 0;
  std::vector<TissueBatch> batches_;    // of the first half, the second half and the crossed elements
  std::array<std::size_t, 4> group_{};  // begin and end of these three groups
  std::vector<std::size_t> order_;
  std::vector<std::array<std::int32_t, 4>> nodes_;  // per element
  std::vector<std::int32_t> position_;              // per element: kElementBatch times its batch, plus its lane
  // The elements around each node: from `first_around_[node]` to `first_around_[node + 1]` in `around_`.
  std::vector<std::int32_t> first_around_, around_;
  // Scratch of `add_around`: per node its place (-1: it is fixed) and its gradient, per element whether it is in
  // `chosen_`, and a batch of them.
  mutable std::vector<std::int32_t> place_, chosen_;
  mutable std::vector<double> gradient_around_;
  mutable std::vector<std::uint8_t> is_chosen_;
  mutable TissueBatch batch_around_;
  mutable RelaxationBatch relaxation_around_;
};

}  // namespace softhand
