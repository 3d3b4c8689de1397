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
  /// S, both triangles. Valid in the first 3 * blocks().size() rows and columns.
  const Dense& stiffness() const { return stiffness_; }
  /// V' half, for block `place` of `blocks()`.
  Vector3 displacement(std::size_t place, const VectorX& half) const;
  /// half += V forces.
  void add_forces(const Eigen::Ref<const VectorX>& forces, VectorX& half) const;
  /// Work since the last call, in floating-point operations of a float factorisation.
  double take_operations() { return std::exchange(operations_, 0.0); }

 private:
  // Kernels work on tiles: kCholeskyTile rows of the three columns of a block. A tile of the matrices below has three
  // rows of a block and kCholeskyTile columns.
  struct alignas(64) Tile {
    double values[3][kCholeskyTile];
  };
  // The columns of V of a block: `ranges_` of tiles of rows, one after another in `tiles_`.
  struct Columns {
    std::size_t first_range = 0, last_range = 0, tiles = 0;
  };
  Matrix3 product(const Tile* a, const Tile* b, Eigen::Index tiles);
  Matrix3 product(const Columns& a, const Columns& b);
  template <typename Visit>
  void for_each_tile(const Columns& columns, Visit&& visit) const;
  Tile* row(std::vector<Tile>& matrix, std::size_t place) const { return matrix.data() + place * tiles_per_row_; }
  void extend_stiffness();
  void append_columns(Eigen::Index first_column);
  bool extend();

  int most_blocks_;
  CholeskyKernel<double> kernel_;
  Eigen::Index rows_;  // of V
  std::size_t tiles_per_row_;
  std::vector<std::int32_t> blocks_;
  std::vector<std::uint8_t> is_known_;  // by block of the core
  std::vector<Columns> columns_;        // by place
  std::vector<std::pair<std::int32_t, std::int32_t>> ranges_;
  std::vector<Tile> tiles_;
  std::size_t known_ = 0;     // so many block rows of S are computed
  std::vector<Tile> factor_;  // L of G = L L', by rows
  std::vector<Matrix3> inverse_diagonal_;
  std::vector<Tile> inverse_;  // of L, by columns
  Dense stiffness_;
  std::vector<ColumnsRow> selection_;
  HalfColumns half_columns_;
  double operations_ = 0;
};

}  // namespace softhand
