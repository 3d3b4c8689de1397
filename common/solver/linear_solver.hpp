// Sparse symmetric positive definite systems in the block pattern of the step.
#pragma once

#include <cstdint>
#include <span>

#include "math/block_matrix.hpp"

namespace softhand {

class LinearSolver {
 public:
  virtual ~LinearSolver() = default;
  /// Orders and analyses the pattern, once. Allocates. std::runtime_error where that fails.
  virtual void analyze(const BlockMatrix& matrix) = 0;
  /// The matrix, of the analysed pattern, whose values `factorize` takes: it stays as it is until then.
  virtual void load(const BlockMatrix& matrix) = 0;
  /// Factorises it; false where they are not positive definite.
  virtual bool factorize() = 0;
  /// The same, where no other stored blocks than `changed` differ from the last matrix that was factorised, which was
  /// positive definite.
  virtual bool refactorize(std::span<const std::int32_t> /*changed*/) { return factorize(); }
  /// x = A^-1 rhs after a successful factorisation; `x` has the size of `rhs`.
  virtual void solve(const VectorX& rhs, VectorX& x) = 0;
  /// Floating-point operations of the last factorisation, whole or in part, and of a whole one; numbers that the factor
  /// stores. 0 where a solver does not say.
  virtual double last_operations() const { return factor_operations(); }
  virtual double factor_operations() const { return 0; }
  virtual double factor_entries() const { return 0; }
  /// Copies the factor of a solver of the same kind that analysed the same pattern; false, and nothing is done, where
  /// it is not one.
  virtual bool take_factor(const LinearSolver& /*other*/) { return false; }
};

}  // namespace softhand
