// Solves sparse symmetric positive definite systems in the block pattern of the step.
//
// A solver of the core factorises A = P^T L L^T P and can be asked for halves of a solve. With these,
// bordered_solver.hpp solves systems with a border.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "math/block_matrix.hpp"

namespace softhand {

/// A block row of some columns of a matrix.
inline constexpr int kColumns = 8;
struct ColumnsRow {
  std::int32_t block = 0;
  Eigen::Matrix<double, 3, kColumns> values;
};
/// Columns of half a solve, row by row. Only the rows in `ranges` differ from zero: [first, second), ascending.
struct HalfColumns {
  Eigen::Matrix<double, Eigen::Dynamic, kColumns, Eigen::RowMajor> values;
  std::vector<std::pair<std::int32_t, std::int32_t>> ranges;
};

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
  /// Halves of a solve, for solvers of the core. half = L^-1 P rhs, and x = P^T L^-T half. Vectors have the size of the
  /// core. Throw std::logic_error if the solver has no halves.
  virtual void forward(const VectorX& rhs, VectorX& half);
  virtual void backward(const VectorX& half, VectorX& x);
  /// half = L^-1 P R for a matrix R with few block rows.
  virtual void forward_columns(std::span<const ColumnsRow> rows, HalfColumns& half);
  /// Floating-point operations of the last factorisation (whole or partial) and of a whole factorisation, and the count
  /// of numbers in the factor. 0 if unknown.
  virtual double last_operations() const { return factor_operations(); }
  virtual double factor_operations() const { return 0; }
  virtual double factor_entries() const { return 0; }
  /// Copies the factor of `other`. Returns false and does nothing if `other` is not of the same kind or analysed
  /// another pattern.
  virtual bool take_factor(const LinearSolver& /*other*/) { return false; }
};

inline void LinearSolver::forward(const VectorX&, VectorX&) {
  throw std::logic_error("this linear solver has no half solves");
}
inline void LinearSolver::backward(const VectorX&, VectorX&) {
  throw std::logic_error("this linear solver has no half solves");
}
inline void LinearSolver::forward_columns(std::span<const ColumnsRow>, HalfColumns&) {
  throw std::logic_error("this linear solver has no half solves");
}

}  // namespace softhand
