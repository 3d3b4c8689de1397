// Solves with a Hessian that has loose blocks (math/block_matrix.hpp), which its factor does not contain.
//
//   (A + L) x = b,   A: the factorised part,   L: the loose blocks
//
// Conjugate gradients with A as preconditioner. A product with A is never needed: the search direction is a sum of
// solutions of A, so its product is the same sum of residuals. L has few blocks, so an iteration costs one solve.
#pragma once

#include "math/block_matrix.hpp"
#include "solver/hessian_factor.hpp"

namespace softhand {

class LooseSolve {
 public:
  explicit LooseSolve(int dof_count);
  /// x := an approximation of (A + L)^-1 rhs, a direction along which the model's energy falls. `factor`: of `hessian`
  /// without its loose blocks. One plain solve if there are no loose blocks. Otherwise two or more, and none after the
  /// second that would exceed `most_work`. Does not allocate.
  void solve(HessianFactor& factor, const BlockMatrix& hessian, const VectorX& rhs, VectorX& x, double most_work,
             StepMeter& meter);

 private:
  VectorX residual_, preconditioned_, direction_, product_;
};

}  // namespace softhand
