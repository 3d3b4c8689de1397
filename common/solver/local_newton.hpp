// Newton's method over a few blocks of unknowns. All other blocks are fixed.
//
// A step that ends before it converges is out of balance. Contact is its stiffest part: a node that is 0.1 mm too deep
// pushes with 1 N. Here only the touched nodes and the touched objects move. Contact and friction are exact. The other
// terms are replaced by the quadratic model of the last Hessian. So an iteration costs the contact terms and a small
// factorisation. It does not evaluate the tissue. The result is a direction: the caller's line search decides with the
// true energy.
#pragma once

#include <Eigen/Core>
#include <bitset>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "solver/linear_solver.hpp"
#include "solver/moving_blocks.hpp"

namespace softhand {

class LocalNewton {
 public:
  /// Upper limit of blocks that move. In a power grasp, a hand of 1,450 nodes touches with about 110 of them, and with
  /// 200 in a step that ends before it converges.
  static constexpr int kMaxBlocks = 256;
  static constexpr int kMaxModes = 6;

  explicit LocalNewton(DofLayout layout);

  struct Result {
    bool found = false;     ///< `direction` lowers the model's energy, and moves something by more than 1 um
    double operations = 0;  ///< floating-point operations of the factors
    int modes = 0;          ///< number of modes; each needs a solve with `factor`
  };
  /// Minimises over the blocks that `kinked` adds to `hessian`, from `state`. With `objects_only` only those in the
  /// border of `hessian` move, the rigid objects. `gradient`: of all terms at `state`. `hessian`: of all terms at a
  /// nearby state, with the part of `kinked` in its journal. This part is lost. `direction` is overwritten with an
  /// increment of `state`, 0 in the fixed blocks. It is unchanged if there are no blocks, more than `kMaxBlocks`, or if
  /// one factorisation needs more than twice `most_operations`; then nothing is found. `most_modes`: at most this many
  /// modes are used, and at most `kMaxModes`. No iteration begins after `most_operations` floating-point operations.
  /// `factor`: of a nearby Hessian; it solves for the modes. Does not allocate.
  Result minimise(const State& state, std::span<Energy* const> kinked, Curvature curvature, const VectorX& gradient,
                  BlockMatrix& hessian, bool objects_only, int most_modes, double most_operations, LinearSolver& factor,
                  VectorX& direction);

 private:
  using Dense = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  template <typename Visit>
  void for_each_pair(const BlockMatrix& hessian, Visit&& visit) const;
  void order_blocks(const BlockMatrix& hessian);
  void gather(const BlockMatrix& hessian, Dense& dense) const;
  void make_modes(const VectorX& gradient, int most_modes, LinearSolver& factor);
  void gather_modes(const BlockMatrix& hessian, const VectorX& gradient);
  Eigen::Index first_column(Eigen::Index row) const;
  bool factorise(double& operations);
  double expected_operations() const;
  void solve(Eigen::Ref<VectorX> step) const;

  DofLayout layout_;
  MovingBlocks blocks_;
  std::vector<std::pair<std::int32_t, std::int32_t>> order_;  // scratch: patch and block
  std::vector<std::bitset<kMaxBlocks>> neighbours_;           // by place: the places that it shares a stored block with
  std::vector<Eigen::Index> first_;  // by place: the first place that it shares a stored block with
  Eigen::Index size_ = 0;            // rows in use: of the blocks, then one for each mode
  std::vector<VectorX> modes_;       // of all blocks, 0 in those that move
  int mode_count_ = 0;
  VectorX force_, product_;                               // scratch, of all blocks
  std::vector<std::pair<double, std::int32_t>> patches_;  // scratch: residual force and root of a patch
  Dense smooth_, factor_;
  VectorX smooth_gradient_;
  VectorX local_gradient_, step_, total_, trial_total_;
};

}  // namespace softhand
