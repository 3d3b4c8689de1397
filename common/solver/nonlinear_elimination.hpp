// Newton's method over the few nodes with the largest residual forces. All other nodes and bodies are fixed.
//
// An iteration of the whole hand can press a few tetrahedra far beyond their strain limit. There, their force grows
// with the third power of the strain. So an iteration of Newton's method leaves (2/3)^3 = 0.30 of the residual, and the
// whole hand needs ten iterations for these few. Here only they are evaluated, until they are in balance with what is
// around them. Source: nonlinear elimination, Lanzkron, Rose and Wilkes 1996, SIAM J. Sci. Comput. 17(2). The result
// is a direction: the caller's line search decides with the true energy.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "solver/dense_cholesky.hpp"
#include "solver/incremental_potential.hpp"

namespace softhand {

class NonlinearElimination {
 public:
  static constexpr int kMaxNodes = 60;

  NonlinearElimination(DofLayout layout, const BlockMatrix& hessian);

  struct Result {
    bool found = false;     ///< `direction` lowers the model's energy
    double share = 0;       ///< evaluated elements over all elements, summed over the terms
    double operations = 0;  ///< floating-point operations of the factors
  };
  /// Minimises over the nodes with the largest residual forces and their neighbours. `potential` knows the gradient at
  /// `state` and `other_stiffness`. Elements around the nodes are exact. The other terms without kinks are quadratic.
  /// So are those with kinks if `has_kinks`: then the journal of the Hessian holds them at `state`. `direction` is
  /// overwritten with an increment of `state` if it is `found`. Does not allocate.
  Result minimise(const State& state, const IncrementalPotential& potential, bool has_kinks, VectorX& direction);

 private:
  void select(const VectorX& gradient);
  double evaluate(const State& state, const VectorX& moves, const IncrementalPotential& potential, Result& result);

  DofLayout layout_;
  // The nodes that share a block with a node: from `first_neighbour_[node]` to `first_neighbour_[node + 1]`.
  std::vector<std::int32_t> first_neighbour_, neighbour_;
  std::vector<std::int32_t> nodes_;  // those that move, ascending
  std::vector<std::int32_t> place_;  // by node: its place in `nodes_`; -1: it is fixed
  State trial_;
  struct OtherBlock {
    Eigen::Index row = 0, column = 0;  // places, row >= column
    Matrix3 value;
  };
  std::vector<OtherBlock> others_;  // stiffness of the other terms
  std::vector<double> blocks_;      // of the elements: see Energy::add_around
  VectorX gradient_, other_gradient_, moves_, trial_moves_, step_, product_;
  DenseCholesky dense_;
};

}  // namespace softhand
