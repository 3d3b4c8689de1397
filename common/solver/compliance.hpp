// Compliance of a few blocks of the core under a factor A = P^T L L^T P: how they give way to forces on each other.
//
//   V = L^-1 P E,   G = V' V = E' A^-1 E,   S = G^-1        E selects the blocks
//
// S is the stiffness of these blocks when the rest of the core gives way (Schur complement). Only the rows of V on the
// paths from the blocks to the root of the elimination tree differ from zero. Only these rows are computed and stored.
// V and S grow block by block. They stay valid as long as the factor does.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "math/instruction_set.hpp"
#include "solver/block_cholesky_kernel.hpp"
#include "solver/linear_solver.hpp"

namespace softhand {

class Compliance {
 public:
  using Dense = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  /// For at most `most_blocks` blocks of a core of `core_count` blocks. No other method allocates, unless V needs more
  /// rows than ever before.
  Compliance(int core_count, int most_blocks, InstructionSet set = widest_instruction_set());

  /// Forgets all blocks. Call it when the factor changes.
  void clear();
  /// Adds blocks of the core that are not known yet. `factor` needs half solves. Returns false if there are
  /// too many blocks (see `room`), or, and then it forgets all blocks, if S is not finite and positive definite.
  bool include(std::span<const std::int32_t> blocks, LinearSolver& factor);

  /// How many more blocks it can hold.
  std::size_t room() const { return static_cast<std::size_t>(most_blocks_) - blocks_.size(); }
  /// In the order in which they were added. Rows and columns of S and the parts of forces have this order.
  std::span<const std::int32_t> blocks() const { return blocks_; }
  bool has(std::int32_t block) const { return is_known_[static_cast<std::size_t>(block)] != 0; }
  /// S in the first 3 * blocks().size() rows and columns. Only the lower triangle is valid.
  const Dense& stiffness() const { return stiffness_; }
  /// product = S x. They may be the same.
  void multiply_stiffness(const Eigen::Ref<const VectorX>& x, Eigen::Ref<VectorX> product);
  /// V' half, for the blocks from place `first` of `blocks()` on.
  void find_displacements(std::size_t first, const VectorX& half, Eigen::Ref<VectorX> displacements);
  /// half += V forces.
  void add_forces(const Eigen::Ref<const VectorX>& forces, VectorX& half);
  /// Work since the last call, in floating-point operations of a float factorisation.
  double take_operations() { return std::exchange(operations_, 0.0); }

 private:
  // Kernels work on tiles of kCholeskyTile columns of V. Blocks that are added together have adjacent columns. The next
  // ones begin with a new tile: columns that are left have the pivot 1 and no force.
  struct alignas(64) Row {
    double values[kCholeskyTile];
  };
  // A tile of V: `ranges_` of its rows, one after another in `v_`.
  struct Columns {
    std::size_t first_range = 0, last_range = 0, first_row = 0;
  };
  template <typename Visit>
  void for_each_range(const Columns& columns, Visit&& visit) const;
  void spread(const Eigen::Ref<const VectorX>& values, Row* columns) const;
  void gather(const Row* columns, std::size_t first, Eigen::Ref<VectorX> values) const;
  void append_columns(std::span<const std::int32_t> blocks, LinearSolver& factor);
  void multiply_columns(std::size_t tile);
  bool extend(std::size_t first);
  void store_stiffness();

  int most_blocks_;
  CholeskyKernel<double> kernel_;
  Eigen::Index rows_;  // of V
  std::size_t most_tiles_;
  std::ptrdiff_t step_;  // from tile row to tile row of the matrices below
  std::vector<std::int32_t> blocks_;
  std::vector<std::size_t> first_column_;  // by place
  std::vector<std::uint8_t> is_known_;     // by block of the core
  std::vector<Columns> columns_;           // by tile
  std::vector<std::pair<std::int32_t, std::int32_t>> ranges_;
  std::vector<Row> v_;
  std::vector<Row> factor_;  // L of G = L L'
  std::vector<double> inverse_diagonal_;
  std::vector<Row> inverse_;  // L^-1, transposed
  std::vector<Row> gram_;     // -S
  Dense stiffness_;
  std::vector<Row> columns_of_x_, columns_of_y_;  // scratch, a number for each column
  std::vector<std::int32_t> pending_;             // blocks to add
  std::vector<ColumnsRow> selection_;
  HalfColumns half_columns_;
  double operations_ = 0;
};

}  // namespace softhand
