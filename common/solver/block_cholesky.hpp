// Multifrontal Cholesky L L^T of the step's matrix: the default linear solver.
//
// Approximate minimum degree ordering of the 3x3 blocks (AMD of SuiteSparse, BSD; the cheapest of a few), supernodes
// merged where a model of the kernels' time gains, blocks added straight into the fronts, dense kernels for the
// processor's vectors (block_cholesky_kernel.hpp). Subtrees of the elimination tree are dealt out to two groups of
// about the same cost, which a second thread may share; their common ancestors follow. Update matrices are kept, so
// that a few changed blocks cost no more than the fronts above them. The same matrix gives the same bits on each run
// and with one thread or two, with one instruction set; sets differ by rounding. Figures: docs/performance.md.
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

/// `Scalar` is what the factor is computed and kept in: double or float. Right-hand sides and solutions are doubles
/// either way; a float factor solves to about 1e-7 times the matrix's condition number, and refuses what is not
/// positive definite in float.
template <typename Scalar>
class BlockCholesky final : public LinearSolver {
 public:
  /// `helper`, if any, takes one of the groups; it outlives this.
  explicit BlockCholesky(InstructionSet set = widest_instruction_set(), HelperThread* helper = nullptr);

  /// Strong exception guarantee is not given: analyse again after a failure. Nothing else here allocates.
  void analyze(const BlockMatrix& matrix) override;
  void load(const BlockMatrix& matrix) override;
  /// False too where a number is not finite.
  bool factorize() override;
  /// Only the fronts on the ways from the changed blocks to the tree's root; the same bits as all of them.
  bool refactorize(std::span<const std::int32_t> changed) override;
  void solve(const VectorX& rhs, VectorX& x) override;
  bool take_factor(const LinearSolver& other) override;

  /// Without padding: a multiplication with an addition counts as two.
  double factor_operations() const override { return operations_; }
  double last_operations() const override;
  double factor_entries() const override { return static_cast<double>(panel_size_); }
  std::size_t front_count() const { return fronts_.size(); }
  /// In the last factorisation.
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

  bool factorize_stale();
  bool factorize_stale(int group);

  CholeskyKernel<Scalar> kernel_;
  HelperThread* helper_ = nullptr;
  double operations_ = 0;
  std::vector<double> front_operations_;
  std::array<std::size_t, 4>
      group_{};  // where the fronts of two groups of subtrees and of their ancestors begin and end
  std::vector<std::int32_t> position_;  // scalar, in elimination order, of each block of the matrix
  std::vector<CholeskyFront> fronts_;
  std::vector<std::int32_t> child_, row_position_, row_in_parent_;
  std::vector<CholeskyEntry> entries_;
  std::vector<CholeskyTileRows> tile_rows_;
  std::vector<std::int32_t> front_of_stored_;  // by stored block of the matrix
  std::vector<std::uint8_t> keeps_update_;     // by front: beyond the factorisation
  std::vector<std::uint8_t> stale_;            // by front
  bool has_updates_ = false;                   // of the last matrix, in full
  const double* values_ = nullptr;             // of the matrix that was loaded
  std::size_t panel_size_ = 0, update_size_ = 0;
  Buffer panels_, updates_, inverse_diagonal_, x_, scratch_;
};

extern template class BlockCholesky<double>;
extern template class BlockCholesky<float>;

}  // namespace softhand
