// Newton's method for contact on the condensed hand.
//
// The touched blocks move, and the rest of the hand gives way exactly, by the Schur complement of the touched blocks
// (compliance.hpp). Contact and friction are exact. The other terms are the quadratic model of their Hessian. So
// contact and friction need no part in the factor, and a contact that begins, ends, sticks or slips renews no factor.
// The direction leads to the minimum of the model over all blocks.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "solver/bordered_solver.hpp"
#include "solver/compliance.hpp"
#include "solver/dense_cholesky.hpp"
#include "solver/moving_blocks.hpp"

namespace softhand {

class CondensedNewton {
 public:
  /// Upper limit of blocks that move. Their matrix is dense.
  static constexpr int kMaxBlocks = 256;
  /// Most blocks of the core with which this solve is cheaper than factors with contact, at most `kMaxBlocks`.
  /// `per_operation`: work of an operation of a float factorisation, in fast steps. The factors of a large mesh are
  /// expensive, so its limit is high.
  static int room(double per_operation);

  explicit CondensedNewton(DofLayout layout);

  enum class Result : std::uint8_t { found, no_room, not_positive };
  /// Minimises over all blocks: the terms `kinked` are exact, and the rest is the quadratic model of `hessian`, which
  /// is without `kinked` and stays so. Its journal must have begun. The residual of the model falls to `tolerance` (N,
  /// N m) or to a hundredth of the first one. `factor`: of `hessian` or of one nearby, with `kept` added. Core and
  /// border must not be coupled. `compliance` belongs to it. `direction` is valid if it is `found`. `no_room`: more
  /// blocks are touched than `compliance` can hold. `not_positive`: a matrix is not positive definite. Does not
  /// allocate.
  Result minimise(const State& state, std::span<Energy* const> kinked, Curvature curvature, const VectorX& gradient,
                  double tolerance, BlockMatrix& hessian, BorderedSolver& factor, std::span<const KeptBlock> kept,
                  Compliance& compliance, VectorX& direction);
  /// `minimise` keeps the factor of its dense matrix for later calls. Call this at the start of a step, and when
  /// `factor` has changed.
  void forget_factor() { has_dense_factor_ = false; }
  /// Number of blocks of the core in the journal of `hessian`. No block moves then (`moves`).
  int touched_blocks(const BlockMatrix& hessian);
  /// Work of `minimise` since the last call, in floating-point operations of a float factorisation.
  double take_operations() { return std::exchange(operations_, 0.0); }
  /// Whether the last minimisation moved the block itself, because a term in `kinked` acts on it.
  bool moves(int block) const { return blocks_.moves(block); }

 private:
  using Dense = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  void include_border(std::int32_t block);
  Result include_touched(const BlockMatrix& hessian, BorderedSolver& factor, std::span<const KeptBlock> kept,
                         Compliance& compliance);
  void gather_border(const BlockMatrix& hessian);
  void condense(const BlockMatrix& hessian, std::span<const KeptBlock> kept, Compliance& compliance);
  template <typename Visit>
  void for_each_kept(const BlockMatrix& hessian, std::span<const KeptBlock> kept, Visit&& visit) const;
  void find_forces(const BlockMatrix& hessian, std::span<const KeptBlock> kept);
  bool serves_again(const BlockMatrix& hessian) const;
  void factorise(const BlockMatrix& hessian, std::span<const KeptBlock> kept, const Compliance& compliance);
  void multiply_smooth(const BlockMatrix& hessian, std::span<const KeptBlock> kept, Compliance& compliance,
                       const VectorX& move, VectorX& product) const;
  double smooth_energy(const Eigen::Ref<const VectorX>& move, const Eigen::Ref<const VectorX>& slope) const;
  void add_kinked_gradient(Eigen::Ref<VectorX> gradient) const;
  bool search(const State& state, std::span<Energy* const> kinked, double& energy);
  double kinked_energy(std::span<Energy* const> kinked, const State& state);

  MovingBlocks blocks_;              // first come those of the border, then those of the compliance
  int border_ = 0;                   // so many are of the border
  Eigen::Index size_ = 0;            // rows in use
  VectorX force_, product_;          // scratch, of all blocks
  VectorX half_;                     // half a solve, in elimination order
  std::vector<std::int32_t> added_;  // scratch
  double operations_ = 0;
  Dense smooth_;  // the blocks between blocks of the border
  DenseCholesky dense_;
  bool has_dense_factor_ = false;
  std::vector<std::int32_t> factored_blocks_;  // the blocks that moved when `dense_` was factorised
  struct Factored {
    std::pair<std::int32_t, std::int32_t> position;
    Matrix3 block;
  };
  std::vector<Factored> factored_;  // the blocks of terms with kinks in it
  VectorX forces_;
  VectorX smooth_gradient_;
  VectorX smooth_slope_, smooth_change_;  // gradient of the smooth model at `total_`, and its change along `step_`
  VectorX local_gradient_, step_, total_, trial_total_;
};

}  // namespace softhand
