// Solves systems whose matrix has a border (block_matrix.hpp):
//
//   | A  B | | x |   | f |        W = L^-1 P B,   A = P^T L L^T P
//   | B' D | | y | = | g |        S = D - W' W    (Schur complement)
//
// The hand is the core A, and the rigid objects are the border. Only objects that something in the core is coupled to
// have columns in W, so an object that nobody touches costs a factor of its own block. The factor of A, and so every
// bit of the core's solution, does not depend on the number of such objects.
//
// S is formed and factorised in double, also if the factor of A is in float. W' W is positive semi-definite, so S loses
// no symmetry by rounding.
#pragma once

#include <memory>
#include <vector>

#include "solver/linear_solver.hpp"

namespace softhand {

/// A stored block that a factor holds in addition to its matrix: the index, and the values.
struct KeptBlock {
  std::int32_t stored = 0;
  Matrix3 value;
};

class BorderedSolver final : public LinearSolver {
 public:
  /// `core` needs half solves if the matrix has a border.
  explicit BorderedSolver(std::unique_ptr<LinearSolver> core) : core_(std::move(core)) {}

  void analyze(const BlockMatrix& matrix) override;
  void load(const BlockMatrix& matrix) override;
  bool factorize() override;
  bool refactorize(std::span<const std::int32_t> changed) override;
  void solve(const VectorX& rhs, VectorX& x) override;
  /// Halves of a solve, if nothing in the core is coupled to the border. Of the border, `half` is `rhs`.
  void forward(const VectorX& rhs, VectorX& half) override;
  void backward(const VectorX& half, VectorX& x) override;
  bool is_coupled() const { return coupled_count_ > 0; }
  LinearSolver& core() { return *core_; }
  bool take_factor(const LinearSolver& other) override;
  double last_operations() const override { return core_->last_operations() + border_operations_; }
  double factor_operations() const override { return core_->factor_operations(); }
  double factor_entries() const override { return core_->factor_entries(); }

 private:
  using Dense = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  // A block B(core, border) that is not zero. `stored` is its transpose.
  struct Coupling {
    std::int32_t border = 0, core = 0, stored = 0;
  };

  bool factorize_border();
  void solve_border();
  void find_components();
  void gather_rows(int group);
  int width_of(int group) const;
  Eigen::Map<const Matrix3> block(std::int32_t stored) const;
  std::int32_t root_of(std::int32_t border) const;

  std::unique_ptr<LinearSolver> core_;
  const BlockMatrix* matrix_ = nullptr;
  int core_count_ = 0, border_count_ = 0;
  double border_operations_ = 0;
  // Blocks of the border are dependent if they are coupled with each other, or both with the core. `order_` has
  // dependent blocks side by side: first those coupled with the core.
  std::vector<std::int32_t> root_, order_, place_;
  std::vector<std::int32_t> component_end_;  // ends of the components in `order_`
  int coupled_count_ = 0;                    // blocks of the border that are coupled with the core
  std::vector<std::uint8_t> is_coupled_;     // by root
  std::vector<Coupling> couplings_;
  std::vector<ColumnsRow> rows_;
  std::vector<std::int32_t> row_of_;       // by block of the core: its place in `rows_`; -1: none
  std::vector<HalfColumns> half_columns_;  // W, in groups of two blocks, in the order of `order_`
  Dense schur_;                            // its factor by components, in the order of `order_`
  VectorX half_, border_;
};

}  // namespace softhand
