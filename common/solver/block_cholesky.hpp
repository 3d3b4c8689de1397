// Multifrontal Cholesky L L^T of the core of the step's matrix: the default linear solver.
//
// - Ordering of the 3x3 blocks: approximate minimum degree (AMD of SuiteSparse, BSD). The cheapest of a few orderings
//   is used.
// - Supernodes are merged if this saves time by a model of the kernels.
// - The blocks of the matrix are added directly into the fronts.
// - Dense kernels use the vector instructions of the processor (block_cholesky_kernel.hpp).
// - Subtrees of the elimination tree form two groups of about equal cost, so that a second thread can take one group.
//   Their common ancestors follow.
// - Update matrices of large subtrees are stored. So if a few blocks change, only the fronts above them are factorised
//   again, with the small subtrees below these fronts.
//
// With one instruction set, the same matrix gives the same bits on each run, with one thread or two. Instruction sets
// differ by rounding. Figures: docs/performance-kernels.md.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "math/helper_thread.hpp"
#include "math/instruction_set.hpp"
#include "solver/block_cholesky_kernel.hpp"
#include "solver/linear_solver.hpp"

namespace softhand {

/// `Scalar` is the type of the factor: double or float. Right-hand sides and solutions are always double. With a float
/// factor the relative error is about 1e-7 times the condition number of the matrix. A float factorisation fails if the
/// matrix is not positive definite in float.
template <typename Scalar>
class BlockCholesky final : public LinearSolver {
 public:
  /// `helper`, if not null, factorises one of the groups. It must outlive this object.
  explicit BlockCholesky(InstructionSet set = widest_instruction_set(), HelperThread* helper = nullptr);

  /// No strong exception guarantee: analyse again after a failure. No other method allocates.
  void analyze(const BlockMatrix& matrix) override;
  void load(const BlockMatrix& matrix) override;
  /// Also returns false if a value is NaN or infinite.
  bool factorize() override;
  /// Factorises only the fronts on the paths from the changed blocks to the root of the tree, and the small subtrees
  /// below these fronts. The bits are the same as those of a whole factorisation.
  bool refactorize(std::span<const std::int32_t> changed) override;
  void solve(const VectorX& rhs, VectorX& x) override;
  void forward(const VectorX& rhs, VectorX& half) override;
  void backward(const VectorX& half, VectorX& x) override;
  void forward_columns(std::span<const ColumnsRow> rows, HalfColumns& half) override;
  bool take_factor(const LinearSolver& other) override;

  /// Without padding. A multiplication with an addition counts as two operations.
  double factor_operations() const override { return operations_; }
  double last_operations() const override;
  double factor_entries() const override { return static_cast<double>(panel_size_); }
  std::size_t front_count() const { return fronts_.size(); }
  /// Number of fronts in the last factorisation.
  std::size_t factorised_fronts() const {
    return static_cast<std::size_t>(std::count(stale_.begin(), stale_.end(), 1));
  }

 private:
  struct Free {
    void operator()(Scalar* memory) const;
  };
  using Buffer = std::unique_ptr<Scalar[], Free>;
  static Buffer make_buffer(std::size_t count);

  CholeskyPlan plan() const;
  void permute(const VectorX& rhs);
  void permute_back(VectorX& x) const;

  bool factorize_stale();
  bool factorize_stale(int group);

  CholeskyKernel<Scalar> kernel_;
  HelperThread* helper_ = nullptr;
  double operations_ = 0;
  std::vector<double> front_operations_;
  // Begin and end of the fronts of the two groups of subtrees and of their common ancestors.
  std::array<std::size_t, 4> group_{};
  std::vector<std::int32_t> position_;  // by block of the matrix: its first scalar in elimination order
  std::vector<CholeskyFront> fronts_;
  std::vector<std::int32_t> child_, row_position_, row_in_parent_;
  std::vector<CholeskyEntry> entries_;
  std::vector<CholeskyTileRows> tile_rows_;
  std::vector<std::int32_t> front_of_stored_;  // by stored block of the matrix
  std::vector<std::uint8_t> stores_update_;    // by front: its update matrix is stored after the factorisation
  std::vector<std::uint8_t> stale_;            // by front: it must be factorised again
  std::vector<std::int32_t> front_of_block_;   // by block of the matrix: the front that eliminates it
  std::vector<std::uint8_t> included_;         // scratch, by front
  bool has_updates_ = false;                   // the stored update matrices are complete and of the last matrix
  const double* values_ = nullptr;             // of the loaded matrix
  std::size_t panel_size_ = 0, update_size_ = 0;
  Buffer panels_, updates_, inverse_diagonal_, x_, scratch_, columns_;
};

extern template class BlockCholesky<double>;
extern template class BlockCholesky<float>;

}  // namespace softhand
