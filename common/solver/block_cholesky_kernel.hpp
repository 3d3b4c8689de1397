// The arithmetic of BlockCholesky: one source (block_cholesky_kernel_source.hpp), compiled for each instruction set.
// Bits depend on the set (fused multiply-adds, order of sums), not on the run.
//
// A front is the dense matrix of a supernode: `pivots` columns that it eliminates and `rows` below them that it
// updates. Its factor, the panel, lies in tiles of kCholeskyTile rows, each tile column by column: a tile is one stream
// for the product kernel, and a row of a tile is the other operand, so nothing is packed or copied. Pivots and rows are
// padded to full tiles; padding is zero, with ones on the diagonal. A front's update matrix is column-major, its lower
// triangle valid.
#pragma once

#include <cstddef>
#include <cstdint>

#include "math/instruction_set.hpp"

namespace softhand {

inline constexpr std::int32_t kCholeskyTile = 8;

/// Counts are of scalars unless they say tiles. Children come before parents.
struct CholeskyFront {
  std::int32_t pivots = 0, pivot_tiles = 0;
  std::int32_t rows = 0, row_tiles = 0;
  std::int32_t first_pivot = 0;  ///< in elimination order
  std::int64_t panel = 0;        ///< offset into the panels
  std::int64_t update = 0;       ///< offset into the update matrices
  std::int32_t row_begin = 0;    ///< into `row_position` and `row_in_parent`: one entry per three rows
  std::int32_t child_begin = 0, child_end = 0;
  std::int32_t entry_begin = 0, entry_end = 0;  ///< blocks of the matrix
  std::int32_t tile_begin = 0, tile_end = 0;    ///< of its rows in its parent
};

/// A block of the matrix in the panel of its front.
struct CholeskyEntry {
  std::int32_t source = 0;  ///< its place among the matrix's stored ones; complemented where it is needed transposed
  std::int32_t place = 0;   ///< of its first scalar, in the panel
};

/// Neighbouring rows of a front that fall into one tile of its parent's panel.
struct CholeskyTileRows {
  std::int32_t tile = 0;
  std::int32_t first = 0;  ///< of the front's rows
  std::uint32_t rows = 0;  ///< of the tile, a bit each
};

/// Entries beyond the last that kernels may read.
inline constexpr std::int32_t kCholeskyEntriesAhead = 16;

/// What analysis found, for a kernel to read.
struct CholeskyPlan {
  const CholeskyFront* fronts = nullptr;
  std::size_t front_count = 0;
  const std::int32_t* child = nullptr;          ///< fronts
  const std::int32_t* row_position = nullptr;   ///< of a block of rows, in elimination order (scalar)
  const std::int32_t* row_in_parent = nullptr;  ///< the same, as padded row of the parent's panel
  const CholeskyEntry* entry = nullptr;         ///< and kCholeskyEntriesAhead more
  const CholeskyTileRows* tile_rows = nullptr;
};

template <typename Scalar>
struct CholeskyKernel {
  /// Fronts [begin, end), whose children are among them or done. `values`: of the matrix, nine a stored block,
  /// column-major. `updates` is followed by kCholeskyTile numbers more, to be read. False where a pivot is not positive
  /// and finite.
  bool (*factorize)(const CholeskyPlan& plan, std::size_t begin, std::size_t end, const double* values, Scalar* panels,
                    Scalar* updates, Scalar* inverse_diagonal);
  /// `x` in elimination order: right-hand side in, solution out. `scratch`: as many as padded rows of the largest
  /// panel.
  void (*solve)(const CholeskyPlan& plan, const Scalar* panels, const Scalar* inverse_diagonal, Scalar* x,
                Scalar* scratch);
};

/// Where this build has none for `set` (another architecture), the baseline's.
template <typename Scalar>
CholeskyKernel<Scalar> cholesky_kernel(InstructionSet set);

}  // namespace softhand
