// The arithmetic of BlockCholesky: one source (block_cholesky_kernel_source.hpp), compiled for each instruction set.
// The bits depend on the set (fused multiply-adds, order of sums), not on the run.
//
// A front is the dense matrix of a supernode: `pivots` columns that it eliminates, and `rows` below them that it
// updates. Its factor is the panel. The panel is stored in tiles of kCholeskyTile rows, each tile column by column. A
// tile is one stream for the product kernel, and a row of a tile is the other operand, so nothing is packed or copied.
// Pivots and rows are padded to full tiles. The padding is zero, with ones on the diagonal. The update matrix of a
// front is column-major. Only its lower triangle is valid.
#pragma once

#include <cstddef>
#include <cstdint>

#include "math/instruction_set.hpp"

namespace softhand {

inline constexpr std::int32_t kCholeskyTile = 8;

/// Counts are in scalars, unless the name says tiles. Children come before parents.
struct CholeskyFront {
  std::int32_t pivots = 0, pivot_tiles = 0;
  std::int32_t rows = 0, row_tiles = 0;
  std::int32_t first_pivot = 0;  ///< in elimination order
  std::int64_t panel = 0;        ///< offset into the panels
  std::int64_t update = 0;       ///< offset into the update matrices
  std::int32_t row_begin = 0;    ///< into `row_position` and `row_in_parent`: one entry per three rows
  std::int32_t child_begin = 0, child_end = 0;
  std::int32_t entry_begin = 0, entry_end = 0;  ///< blocks of the matrix
  std::int32_t tile_begin = 0, tile_end = 0;    ///< into `tile_rows`: its rows in its parent
};

/// A block of the matrix in the panel of its front.
struct CholeskyEntry {
  std::int32_t source = 0;  ///< index among the stored blocks of the matrix; bitwise complement: use it transposed
  std::int32_t place = 0;   ///< of its first scalar, in the panel
};

/// Adjacent rows of a front that belong to one tile of its parent's panel.
struct CholeskyTileRows {
  std::int32_t tile = 0;
  std::int32_t first = 0;  ///< the first of these rows in the front
  std::uint32_t rows = 0;  ///< a bit for each row of the tile
};

/// Kernels may read this many entries after the last one.
inline constexpr std::int32_t kCholeskyEntriesAhead = 16;

/// The result of the analysis, for the kernels.
struct CholeskyPlan {
  const CholeskyFront* fronts = nullptr;
  std::size_t front_count = 0;
  const std::int32_t* child = nullptr;          ///< indices of fronts
  const std::int32_t* row_position = nullptr;   ///< by block of rows: its first scalar in elimination order
  const std::int32_t* row_in_parent = nullptr;  ///< by block of rows: its padded row in the parent's panel
  const CholeskyEntry* entry = nullptr;         ///< followed by kCholeskyEntriesAhead more
  const CholeskyTileRows* tile_rows = nullptr;
};

template <typename Scalar>
struct CholeskyKernel {
  /// Factorises the fronts [begin, end). Their children are among them or already factorised. `values`: of the matrix,
  /// nine per stored block, column-major. `updates` is followed by kCholeskyTile more numbers that may be read. Returns
  /// false if a pivot is not positive and finite.
  bool (*factorize)(const CholeskyPlan& plan, std::size_t begin, std::size_t end, const double* values, Scalar* panels,
                    Scalar* updates, Scalar* inverse_diagonal);
  /// x := L^-1 x, in elimination order. The size of `scratch` is the number of padded rows of the largest panel.
  void (*forward)(const CholeskyPlan& plan, const Scalar* panels, const Scalar* inverse_diagonal, Scalar* x,
                  Scalar* scratch);
  /// x := L^-T x.
  void (*backward)(const CholeskyPlan& plan, const Scalar* panels, const Scalar* inverse_diagonal, Scalar* x,
                   Scalar* scratch);
  /// x := L^-1 x for kCholeskyTile columns, stored row by row. `included`: by front, 0 if its rows of x are zero. The
  /// ancestors of an included front must be included. `scratch` has kCholeskyTile times the size above.
  void (*forward_columns)(const CholeskyPlan& plan, const std::uint8_t* included, const Scalar* panels,
                          const Scalar* inverse_diagonal, Scalar* x, Scalar* scratch);
  /// sums -= A' B for kCholeskyTile columns of A and of B, stored row by row. The entry j * kCholeskyTile + i of `sums`
  /// is for column i of A and column j of B. Aligned to 64 bytes, as are the next ones.
  void (*subtract_products)(const Scalar* a, const Scalar* b, std::int32_t rows, Scalar* sums);
  /// sums += A' x, and y += A factors, for such an A.
  void (*add_transposed)(const Scalar* a, const Scalar* x, std::int32_t rows, Scalar* sums);
  void (*add_columns)(const Scalar* a, const Scalar* factors, std::int32_t rows, Scalar* y);
  /// A symmetric matrix grows by tile rows: `extend_factor` continues its Cholesky factor L from tile row `first` up to
  /// `end`. A tile row begins at a multiple of `step` and is stored column by column, as in a panel. The tile rows
  /// before `first` hold L, the others the lower triangle of the matrix. Returns false if a pivot is not positive and
  /// finite.
  bool (*extend_factor)(std::int32_t first, std::int32_t end, std::ptrdiff_t step, Scalar* factor,
                        Scalar* inverse_diagonal);
  /// Continues M = L^-1. `inverse` holds its transpose in tile rows. It must have been zero at first.
  void (*extend_inverse)(std::int32_t first, std::int32_t end, std::ptrdiff_t step, const Scalar* factor,
                         const Scalar* inverse_diagonal, Scalar* inverse);
  /// Continues -M' M. Only the tiles of the lower triangle are valid.
  void (*extend_gram)(std::int32_t first, std::int32_t end, std::ptrdiff_t step, const Scalar* inverse, Scalar* gram);
  /// y -= A x for a symmetric matrix in such tiles.
  void (*subtract_symmetric)(std::int32_t end, std::ptrdiff_t step, const Scalar* matrix, const Scalar* x, Scalar* y);
};

/// Returns the baseline's kernel if this build has none for `set` (another architecture).
template <typename Scalar>
CholeskyKernel<Scalar> cholesky_kernel(InstructionSet set);

}  // namespace softhand
