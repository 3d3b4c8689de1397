// The arithmetic of BlockCholesky: one source (block_cholesky_kernel_source.hpp), compiled for each instruction set. Bits depend on the set (fused
// multiply-adds, order of sums), not on the run.
//
// A front is the dense matrix of a supernode: `pivots` columns that it eliminates and `rows` below them that it updates. Its factor, the panel, lies in tiles of
// kCholeskyTile rows, each tile column by column: a tile is one stream for the product kernel, and a row of a tile is the other operand, so nothing is packed or
// copied. Pivots and rows are padded to full tiles; padding is zero, with ones on the diagonal. A front's update matrix is column-major, its lower triangle valid.
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
  std::int32_t first_pivot = 0;    ///< in elimination order
  std::int64_t panel = 0;          ///< offset into the panels
  std::int64_t update = 0;         ///< offset into the update matrices; shared by fronts that are never alive together
  std::int32_t row_begin = 0;      ///< into `row_position` and `row_in_parent`: one entry per three rows
  std::int32_t child_begin = 0, child_end = 0;
  std::int32_t entry_begin = 0, entry_end = 0;
};

/// What analysis found, for a kernel to read.
struct CholeskyPlan {
  const CholeskyFront* fronts = nullptr;
  std::size_t front_count = 0;
  const std::int32_t* child = nullptr;          ///< fronts
  const std::int32_t* row_position = nullptr;   ///< of a block of rows, in elimination order (scalar)
  const std::int32_t* row_in_parent = nullptr;  ///< the same, as padded row of the parent's panel
  const std::int32_t* entry_row = nullptr;      ///< padded panel row of a block of the matrix
  const std::int32_t* entry_column = nullptr;   ///< panel column of it
  const std::int32_t* entry_source = nullptr;   ///< that block's place among the matrix's stored ones; complemented where it is needed transposed
};

template <typename Scalar>
struct CholeskyKernel {
  /// Fronts [begin, end), whose children are among them or done. `values`: of the matrix, nine a stored block, column-major. `scratch`: as many as padded rows of the largest
  /// panel. False where a pivot is not positive and finite.
  bool (*factorize)(const CholeskyPlan& plan, std::size_t begin, std::size_t end, const double* values, Scalar* panels, Scalar* updates, Scalar* inverse_diagonal,
                    std::int32_t* scratch);
  /// `x` in elimination order: right-hand side in, solution out. `scratch` as above.
  void (*solve)(const CholeskyPlan& plan, const Scalar* panels, const Scalar* inverse_diagonal, Scalar* x, Scalar* scratch);
};

/// Where this build has none for `set` (another architecture), the baseline's.
template <typename Scalar>
CholeskyKernel<Scalar> cholesky_kernel(InstructionSet set);

}  // namespace softhand
