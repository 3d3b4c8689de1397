// Solves sparse symmetric positive definite systems in the block pattern of the step.
#pragma once

#include <cstdint>
#include <span>

#include "math/block_matrix.hpp"

namespace softhand {

class LinearSolver {
 public:
  virtual ~LinearSolver() = default;
  /// Orders and analyses the pattern, once. Allocates. Throws std::runtime_error if it fails.
  virtual void analyze(const BlockMatrix& matrix) = 0;
  /// Sets the matrix that `factorize` factorises. It must have the analysed pattern, and must not change before
  /// `factorize`.
  virtual void load(const BlockMatrix& matrix) = 0;
  /// Factorises the loaded matrix. Returns false if the matrix is not positive definite.
  virtual bool factorize() = 0;
  /// The same, if only the stored blocks `changed` differ from the last factorised matrix. That matrix must have been
  /// positive definite.
  virtual bool refactorize(std::span<const std::int32_t> /*changed*/) { return factorize(); }
  /// x = A^-1 rhs after a successful factorisation. `x` must have the size of `rhs`.
  virtual void solve(const VectorX& rhs, VectorX& x) = 0;
  /// Floating-point operations of the last factorisation (whole or partial) and of a whole factorisation, and the count
  /// of numbers in the factor. 0 if unknown.
  virtual double last_operations() const { return factor_operations(); }
  virtual double factor_operations() const { return 0; }
  virtual double factor_entries() const { return 0; }
  /// Copies the factor of `other`. Returns false and does nothing if `other` is not of the same kind or analysed
  /// another pattern.
  virtual bool take_factor(const LinearSolver& /*other*/) { return false; }
};

}  // namespace softhand
