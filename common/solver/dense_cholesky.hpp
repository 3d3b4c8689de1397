// Cholesky factor of a small dense matrix of 3x3 blocks whose size changes. It has the kernels of BlockCholesky: the
// whole matrix is one front.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "math/instruction_set.hpp"
#include "math/types.hpp"
#include "solver/block_cholesky_kernel.hpp"

namespace softhand {

class DenseCholesky {
 public:
  using Dense = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  /// No other method allocates.
  explicit DenseCholesky(int most_blocks, InstructionSet set = widest_instruction_set());

  /// A := the block diagonal matrix of the first `first_size` rows and columns of `first` and the first `second_size`
  /// of `second`. Both are symmetric. It reads their lower triangles. The sizes are multiples of three. The factor
  /// stays as it is.
  void assign(const Dense& first, Eigen::Index first_size, const Dense& second, Eigen::Index second_size);
  /// A := the matrix of these blocks: the lower triangle by rows of blocks, nine numbers per block, column-major.
  void assign(std::span<const double> blocks, Eigen::Index size);
  /// Adds to the block of A at a row and a column of blocks, row >= column.
  void add(Eigen::Index row, Eigen::Index column, const Matrix3& block) {
    Eigen::Map<Matrix3>(values_.data() + 9 * (row * (row + 1) / 2 + column)) += block;
  }
  /// Factorises A. Returns false if it is not positive definite.
  bool factorize();
  /// x := A^-1 x with the last factor. The size of `x` is that of the factor.
  void solve(Eigen::Ref<Eigen::VectorXd> x);
  /// Floating-point operations of the last factorisation.
  double operations() const;

 private:
  CholeskyPlan plan() const { return {&front_, 1, nullptr, nullptr, nullptr, entries_.data(), nullptr}; }

  CholeskyKernel<double> kernel_;
  CholeskyFront front_;
  std::vector<CholeskyEntry> entries_;
  Eigen::Index size_ = 0;
  std::vector<double> values_;  // of A: lower triangle by block rows, nine per block
  struct Free {
    void operator()(double* memory) const;
  };
  using Buffer = std::unique_ptr<double[], Free>;
  static Buffer make_buffer(std::size_t count);
  Buffer panel_, update_, inverse_diagonal_, x_, scratch_;
};

}  // namespace softhand
