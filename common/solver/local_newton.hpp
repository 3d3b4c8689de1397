// Newton's method over a few blocks of unknowns. All other blocks are fixed.
//
// A step that ends before it converges is out of balance. Contact is its stiffest part: a node that is 0.1 mm too deep
// pushes with 1 N. Here only the touched nodes and the touched objects move. Contact and friction are exact. The other
// terms are replaced by the quadratic model of the last Hessian. So an iteration costs the contact terms and a small
// factorisation. It does not evaluate the tissue. The result is a direction: the caller's line search decides with the
// true energy.
//
// `minimise_condensed` lets the rest of the hand give way exactly, by the Schur complement of the touched blocks
// (compliance.hpp). Then contact and friction need no part in the factor, and a contact that begins, ends, sticks or
// slips renews no factor. Its direction leads to the minimum of the model over all blocks.
#pragma once

#include <Eigen/Core>
#include <bitset>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "energies/energy.hpp"
#include "math/block_matrix.hpp"
#include "model/state.hpp"
#include "solver/bordered_solver.hpp"
#include "solver/compliance.hpp"
#include "solver/dense_cholesky.hpp"

namespace softhand {

class LocalNewton {
 public:
  /// Upper limit of blocks that move. In a power grasp, a hand of 1,450 nodes touches with about 110 of them, and with
  /// 200 in a step that ends before it converges.
  static constexpr int kMaxBlocks = 256;
  /// The same for the condensed solve, whose matrix is dense.
  static constexpr int kMaxCondensedBlocks = 256;
  static constexpr int kMaxModes = 6;
  /// Most blocks of the core with which the condensed solve is cheaper than factors with contact, at most
  /// `kMaxCondensedBlocks`. `per_operation`: work of an operation of a float factorisation, in fast steps. The factors
  /// of a large mesh are expensive, so its limit is high.
  static int condensed_room(double per_operation);

  explicit LocalNewton(DofLayout layout);

  struct Result {
    bool found = false;     ///< `direction` lowers the model's energy, and moves something by more than 1 um
    double operations = 0;  ///< floating-point operations of the factors
    int modes = 0;          ///< number of modes; each needs a solve with `factor`
  };
  /// Minimises over the blocks that `kinked` adds to `hessian`, from `state`. `gradient`: of all terms at `state`.
  /// `hessian`: of all terms at a nearby state, with the part of `kinked` in its journal. This part is lost.
  /// `direction` is overwritten with an increment of `state`, 0 in the fixed blocks. It is unchanged if there are no
  /// blocks, more than `kMaxBlocks`, or if one factorisation needs more than twice `most_operations`; then nothing is
  /// found. `most_modes`: at most this many modes are used, and at most `kMaxModes`. No iteration begins after
  /// `most_operations` floating-point operations. `factor`: of a nearby Hessian; it solves for the modes. Does not
  /// allocate.
  Result minimise(const State& state, std::span<Energy* const> kinked, Curvature curvature, const VectorX& gradient,
                  BlockMatrix& hessian, int most_modes, double most_operations, LinearSolver& factor,
                  VectorX& direction);

  enum class Condensed : std::uint8_t { found, no_room, not_positive };
  /// Minimises over all blocks: the terms `kinked` are exact, and the rest is the quadratic model of `hessian`, which
  /// is without `kinked` and stays so. Its journal must have begun. The residual of the model falls to `tolerance` (N,
  /// N m) or to a hundredth of the first one. `factor`: of `hessian` or of one nearby, with `kept` added. Core and
  /// border must not be coupled. `compliance` belongs to it. `direction` is valid if it is `found`. `no_room`: more
  /// blocks are touched than `compliance` can hold. `not_positive`: a matrix is not positive definite. Does not
  /// allocate.
  Condensed minimise_condensed(const State& state, std::span<Energy* const> kinked, Curvature curvature,
                               const VectorX& gradient, double tolerance, BlockMatrix& hessian, BorderedSolver& factor,
                               std::span<const KeptBlock> kept, Compliance& compliance, VectorX& direction);
  /// `minimise_condensed` keeps the factor of its dense matrix for later calls. Call this at the start of a step, and
  /// when `factor` has changed.
  void forget_factor() { has_dense_factor_ = false; }
  /// Number of blocks of the core in the journal of `hessian`.
  int touched_blocks(const BlockMatrix& hessian);
  /// Work of `minimise_condensed` since the last call, in floating-point operations of a float factorisation.
  double take_operations() { return std::exchange(condensed_operations_, 0.0); }
  /// Whether the last minimisation moved the block itself, because a term in `kinked` acts on it.
  bool moves(int block) const { return place_[static_cast<std::size_t>(block)] >= 0; }

 private:
  using Dense = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  void forget_blocks();
  void include_journal(const BlockMatrix& hessian);
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
  void include_border(std::int32_t block);
  Condensed include_touched(const BlockMatrix& hessian, BorderedSolver& factor, std::span<const KeptBlock> kept,
                            Compliance& compliance);
  void gather_border(const BlockMatrix& hessian);
  void condense(const BlockMatrix& hessian, std::span<const KeptBlock> kept, const Compliance& compliance);
  template <typename Visit>
  void for_each_kept(const BlockMatrix& hessian, std::span<const KeptBlock> kept, Visit&& visit) const;
  void find_forces(const BlockMatrix& hessian, std::span<const KeptBlock> kept);
  bool serves_again(const BlockMatrix& hessian) const;
  void factorise_condensed(const BlockMatrix& hessian, std::span<const KeptBlock> kept, const Compliance& compliance);
  void multiply_smooth(const BlockMatrix& hessian, std::span<const KeptBlock> kept, const Compliance& compliance,
                       const VectorX& move, VectorX& product) const;
  double smooth_energy(const Eigen::Ref<const VectorX>& move, const Eigen::Ref<const VectorX>& slope) const;
  void add_kinked_gradient(Eigen::Ref<VectorX> gradient) const;
  bool search(const State& state, std::span<Energy* const> kinked, double& energy);
  double kinked_energy(std::span<Energy* const> kinked, const State& state);
  void move_to(const State& state, const Eigen::Ref<const VectorX>& move);

  DofLayout layout_;
  std::vector<std::int32_t> blocks_;                          // the blocks that move
  std::vector<std::int32_t> place_;                           // by block: its place in `blocks_`, -1: it is fixed
  std::vector<std::pair<std::int32_t, std::int32_t>> order_;  // scratch: patch and block
  std::vector<std::bitset<kMaxBlocks>> neighbours_;           // by place: the places that it shares a stored block with
  std::vector<Eigen::Index> first_;  // by place: the first place that it shares a stored block with
  Eigen::Index size_ = 0;            // rows in use: of the blocks, then one for each mode
  std::vector<VectorX> modes_;       // of all blocks, 0 in those that move
  int mode_count_ = 0;
  VectorX force_, product_;                               // scratch, of all blocks
  std::vector<std::pair<double, std::int32_t>> patches_;  // scratch: residual force and root of a patch
  int border_ = 0;  // of the condensed problem: first come so many blocks of the border, then those of the compliance
  std::vector<std::int32_t> added_;  // scratch
  double condensed_operations_ = 0;
  VectorX half_;  // half a solve, in elimination order
  Dense smooth_, factor_;
  DenseCholesky dense_;
  bool has_dense_factor_ = false;
  std::vector<std::int32_t> factored_blocks_;  // `blocks_` of the factor in `dense_`
  struct Factored {
    std::pair<std::int32_t, std::int32_t> position;
    Matrix3 block;
  };
  std::vector<Factored> factored_;  // the blocks of terms with kinks in it
  VectorX forces_;
  VectorX smooth_gradient_;
  VectorX smooth_slope_, smooth_change_;  // gradient of the smooth model at `total_`, and its change along `step_`
  VectorX local_gradient_, step_, total_, trial_total_;
  VectorX kinked_gradient_;  // of all blocks
  State trial_;
};

}  // namespace softhand
