// Supernodal sparse Cholesky L L^T of SuiteSparse, with approximate minimum degree ordering and one BLAS thread. The
// supernodal module is GPL.
#pragma once

#include <memory>

#include "solver/linear_solver.hpp"

namespace softhand {

class CholmodSolver final : public LinearSolver {
 public:
  enum class Order { minimum_degree, nested_dissection };
  explicit CholmodSolver(Order order = Order::minimum_degree);
  ~CholmodSolver() override;
  CholmodSolver(const CholmodSolver&) = delete;
  CholmodSolver& operator=(const CholmodSolver&) = delete;

  void analyze(const BlockMatrix& matrix) override;
  void load(const BlockMatrix& matrix) override;
  bool factorize() override;
  void solve(const VectorX& rhs, VectorX& x) override;
  void forward(const VectorX& rhs, VectorX& half) override;
  void backward(const VectorX& half, VectorX& x) override;
  void forward_columns(std::span<const ColumnsRow> rows, HalfColumns& half) override;

 private:
  struct Workspace;
  bool apply(int system, const double* from, int columns);
  void half_solve(int first, int second, const VectorX& from, VectorX& to);
  const double* solution() const;

  VectorX scratch_;
  std::unique_ptr<Workspace> workspace_;
};

}  // namespace softhand
