// Cholesky factor of a small dense matrix of 3x3 blocks whose size changes. It has the kernels of BlockCholesky: the
// whole matrix is one front.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "math/instruction_set.hpp"
#include "solver/block_cholesky_kernel.hpp"

namespace softhand {

class DenseCholesky {
 public:
  using Dense = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  /// No other method allocates.
  explicit DenseCholesky(int most_blocks, InstructionSet set = widest_instruction_set());

  /// Factorises the first `size` rows and columns of a symmetric matrix, of which it reads the lower triangle. `size`
  /// is a multiple of three. Returns false if the matrix is not positive definite.
  bool factorize(const Dense& matrix, Eigen::Index size);
  /// x := A^-1 x. The size of `x` is that of the matrix.
  void solve(Eigen::Ref<Eigen::VectorXd> x);
  /// Floating-point operations of the last factorisation.
  double operations() const;

 private:
  CholeskyPlan plan() const { return {&front_, 1, nullptr, nullptr, nullptr, entries_.data(), nullptr}; }

  CholeskyKernel<double> kernel_;
  CholeskyFront front_;
  std::vector<CholeskyEntry> entries_;
  std::vector<double> values_;  // lower triangle by block rows, nine per block
  struct Free {
    void operator()(double* memory) const;
  };
  using Buffer = std::unique_ptr<double[], Free>;
  static Buffer make_buffer(std::size_t count);
  Buffer panel_, update_, inverse_diagonal_, x_, scratch_;
};

}  // namespace softhand
