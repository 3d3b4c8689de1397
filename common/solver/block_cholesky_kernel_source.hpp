// The single source of the factorisation's kernels: see block_cholesky_kernel.hpp. Include it once in one file per
// instruction set. Everything here has internal linkage, and no template of the standard library or Eigen is
// instantiated. Reason: the linker could use such a shared function, with this file's instructions, in the whole
// program.
#pragma once

#include <utility>

#include "solver/block_cholesky_kernel.hpp"
#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace softhand {
namespace {

#define SOFTHAND_INLINE [[gnu::always_inline]] inline

constexpr int kTile = kCholeskyTile;

#if defined(__AVX512F__)
constexpr int kVectorBytes = 64, kRegisters = 32;
#elif defined(__AVX2__)
constexpr int kVectorBytes = 32, kRegisters = 16;
#else
constexpr int kVectorBytes = 16, kRegisters = 16;
#endif

// A tile's column in machine vectors. A column of floats is half an AVX-512 vector. On processors that split these
// vectors this is as fast, and all instruction sets share one layout.
template <typename Scalar>
struct Shape {
  static constexpr int kTileBytes = kTile * static_cast<int>(sizeof(Scalar));
  static constexpr int kBytes = kVectorBytes < kTileBytes ? kVectorBytes : kTileBytes;
  static constexpr int kWidth = kBytes / static_cast<int>(sizeof(Scalar));
  static constexpr int kParts = kTile / kWidth;
  // The product kernel's block of accumulators: tiles x columns, most of the registers.
  static constexpr int kTiles = kParts == 1 ? 3 : 1;
  static constexpr int kColumns = kRegisters == 32 ? 8 : (kParts <= 2 ? 4 : 2);
  typedef Scalar Vector __attribute__((vector_size(kBytes), may_alias));
  typedef Scalar Unaligned __attribute__((vector_size(kBytes), aligned(sizeof(Scalar)), may_alias));
};

template <typename Scalar>
SOFTHAND_INLINE typename Shape<Scalar>::Vector& vector_at(Scalar* at) {
  return *reinterpret_cast<typename Shape<Scalar>::Vector*>(at);
}
template <typename Scalar>
SOFTHAND_INLINE const typename Shape<Scalar>::Vector& vector_at(const Scalar* at) {
  return *reinterpret_cast<const typename Shape<Scalar>::Vector*>(at);
}

template <typename Vector>
SOFTHAND_INLINE auto sum_of(const Vector& vector) {
  auto sum = vector[0];
  for (unsigned i = 1; i < sizeof(vector) / sizeof(sum); ++i) sum += vector[i];
  return sum;
}

// The sums of neighbours, first those of `a`.
template <typename Vector, int... Pair>
SOFTHAND_INLINE Vector sum_neighbours(const Vector& a, const Vector& b, std::integer_sequence<int, Pair...>) {
  return __builtin_shufflevector(a, b, (2 * Pair)...) + __builtin_shufflevector(a, b, (2 * Pair + 1)...);
}

// The sums of as many vectors as a vector has entries. Overwrites them.
template <typename Scalar>
SOFTHAND_INLINE typename Shape<Scalar>::Vector sums_of(typename Shape<Scalar>::Vector* vectors) {
  constexpr int kWidth = Shape<Scalar>::kWidth;
  for (int count = kWidth; count > 1; count /= 2) {
    for (int k = 0; k < count / 2; ++k)
      vectors[k] = sum_neighbours(vectors[2 * k], vectors[2 * k + 1], std::make_integer_sequence<int, kWidth>{});
  }
  return vectors[0];
}

// C = [C] - A B^T for `Tiles` tiles of A below each other and `Columns` rows of a tile of B, over `depth` columns of
// both. Strides: `tile_step` from tile to tile of A, `c_tile_step` and `c_column_step` in C.
template <typename Scalar, int Tiles, int Columns, bool Accumulate>
SOFTHAND_INLINE void multiply_block(const Scalar* a, std::ptrdiff_t tile_step, const Scalar* b, std::ptrdiff_t depth,
                                    Scalar* c, std::ptrdiff_t c_tile_step, std::ptrdiff_t c_column_step) {
  using S = Shape<Scalar>;
  using Vector = typename S::Vector;
  Vector sum[Columns][Tiles][S::kParts] = {};
  for (std::ptrdiff_t p = 0; p < depth; ++p) {
    Vector column[Tiles][S::kParts];
#pragma GCC unroll 3
    for (int t = 0; t < Tiles; ++t) {
#pragma GCC unroll 4
      for (int k = 0; k < S::kParts; ++k) column[t][k] = vector_at(a + t * tile_step + p * kTile + k * S::kWidth);
    }
#pragma GCC unroll 8
    for (int j = 0; j < Columns; ++j) {
      const Scalar factor = b[p * kTile + j];
#pragma GCC unroll 3
      for (int t = 0; t < Tiles; ++t) {
#pragma GCC unroll 4
        for (int k = 0; k < S::kParts; ++k) sum[j][t][k] += column[t][k] * factor;
      }
    }
  }
#pragma GCC unroll 8
  for (int j = 0; j < Columns; ++j) {
#pragma GCC unroll 3
    for (int t = 0; t < Tiles; ++t) {
#pragma GCC unroll 4
      for (int k = 0; k < S::kParts; ++k) {
        Vector& result = vector_at(c + t * c_tile_step + j * c_column_step + k * S::kWidth);
        if constexpr (Accumulate) {
          result -= sum[j][t][k];
        } else {
          result = -sum[j][t][k];
        }
      }
    }
  }
}

// The same for a column of `tiles` tiles of A and all rows of the tile of B.
template <typename Scalar, bool Accumulate>
void multiply(const Scalar* a, std::ptrdiff_t tile_step, int tiles, const Scalar* b, std::ptrdiff_t depth, Scalar* c,
              std::ptrdiff_t c_tile_step, std::ptrdiff_t c_column_step) {
  using S = Shape<Scalar>;
  for (int j = 0; j < kTile; j += S::kColumns) {
    int t = 0;
    for (; t + S::kTiles <= tiles; t += S::kTiles) {
      multiply_block<Scalar, S::kTiles, S::kColumns, Accumulate>(a + t * tile_step, tile_step, b + j, depth,
                                                                 c + t * c_tile_step + j * c_column_step, c_tile_step,
                                                                 c_column_step);
    }
    if constexpr (S::kTiles == 3) {
      if (tiles - t == 2) {
        multiply_block<Scalar, 2, S::kColumns, Accumulate>(a + t * tile_step, tile_step, b + j, depth,
                                                           c + t * c_tile_step + j * c_column_step, c_tile_step,
                                                           c_column_step);
      } else if (tiles - t == 1) {
        multiply_block<Scalar, 1, S::kColumns, Accumulate>(a + t * tile_step, tile_step, b + j, depth,
                                                           c + t * c_tile_step + j * c_column_step, c_tile_step,
                                                           c_column_step);
      }
    }
  }
}

// Computes the Cholesky factor of one tile in place. The strictly upper triangle is garbage afterwards and must not be
// read.
template <typename Scalar>
SOFTHAND_INLINE bool factorize_tile(Scalar* tile, Scalar* inverse_diagonal) {
  using S = Shape<Scalar>;
  for (int c = 0; c < kTile; ++c) {
    const Scalar pivot = tile[c * kTile + c];
    if (!(pivot > Scalar(0) && pivot <= (sizeof(Scalar) == 8 ? __DBL_MAX__ : double{__FLT_MAX__}))) return false;
    Scalar root = pivot;
    if constexpr (sizeof(Scalar) == 8) {
      root = __builtin_sqrt(pivot);
    } else {
      root = __builtin_sqrtf(pivot);
    }
    const Scalar inverse = Scalar(1) / root;
    inverse_diagonal[c] = inverse;
    for (int k = 0; k < S::kParts; ++k) vector_at(tile + c * kTile + k * S::kWidth) *= inverse;
    for (int j = c + 1; j < kTile; ++j) {
      const Scalar factor = tile[c * kTile + j];
      for (int k = 0; k < S::kParts; ++k)
        vector_at(tile + j * kTile + k * S::kWidth) -= vector_at(tile + c * kTile + k * S::kWidth) * factor;
    }
  }
  return true;
}

// X = X L^-T for tiles below the diagonal tile `l`.
template <typename Scalar>
SOFTHAND_INLINE void divide(Scalar* x, std::ptrdiff_t tile_step, int tiles, const Scalar* l,
                            const Scalar* inverse_diagonal) {
  using S = Shape<Scalar>;
  for (int t = 0; t < tiles; ++t) {
    for (int k = 0; k < S::kParts; ++k) {
      Scalar* at = x + t * tile_step + k * S::kWidth;
      typename S::Vector column[kTile];
#pragma GCC unroll 8
      for (int c = 0; c < kTile; ++c) column[c] = vector_at(at + c * kTile);
#pragma GCC unroll 8
      for (int c = 0; c < kTile; ++c) {
        column[c] *= inverse_diagonal[c];
#pragma GCC unroll 8
        for (int j = c + 1; j < kTile; ++j) column[j] -= column[c] * l[c * kTile + j];
      }
#pragma GCC unroll 8
      for (int c = 0; c < kTile; ++c) vector_at(at + c * kTile) = column[c];
    }
  }
}

SOFTHAND_INLINE std::ptrdiff_t tile_step_of(const CholeskyFront& front) {
  return static_cast<std::ptrdiff_t>(front.pivot_tiles) * kTile * kTile;
}
// Where row `row` of a panel begins; columns follow at kTile.
SOFTHAND_INLINE std::ptrdiff_t row_offset(std::ptrdiff_t row, std::ptrdiff_t tile_step) {
  return (row / kTile) * tile_step + row % kTile;
}

template <typename Scalar>
SOFTHAND_INLINE void assemble_entries(const CholeskyPlan& plan, const CholeskyFront& front, const double* values,
                                      Scalar* panel) {
  const std::ptrdiff_t step = tile_step_of(front);
  const std::ptrdiff_t size = (front.pivot_tiles + front.row_tiles) * step;
  for (std::ptrdiff_t k = 0; k < size; k += Shape<Scalar>::kWidth)
    vector_at(panel + k) = typename Shape<Scalar>::Vector{};
  for (std::ptrdiff_t c = front.pivots; c < static_cast<std::ptrdiff_t>(front.pivot_tiles) * kTile; ++c)
    panel[row_offset(c, step) + c * kTile] = Scalar(1);
  for (const CholeskyEntry* entry = plan.entry + front.entry_begin; entry != plan.entry + front.entry_end; ++entry) {
    // Prefetch: the matrix has another order and is larger than the caches near the core.
    const std::int32_t prefetched = entry[kCholeskyEntriesAhead].source;
    const double* const block_ahead =
        values + 9 * static_cast<std::ptrdiff_t>(prefetched < 0 ? ~prefetched : prefetched);
    __builtin_prefetch(block_ahead);
    __builtin_prefetch(block_ahead + 8);
    const bool transposed = entry->source < 0;
    const double* const block = values + 9 * static_cast<std::ptrdiff_t>(transposed ? ~entry->source : entry->source);
    Scalar* const to = panel + entry->place;
    const int remaining = kTile - static_cast<int>(entry->place % kTile);  // rows to the tile's end
    const auto copy = [&](int down, int across, std::ptrdiff_t beyond) {
#pragma GCC unroll 3
      for (int c = 0; c < 3; ++c) {
#pragma GCC unroll 3
        for (int r = 0; r < 3; ++r)
          to[c * kTile + r + (r < remaining ? 0 : beyond)] = static_cast<Scalar>(block[across * c + down * r]);
      }
    };
    if (remaining < 3) {
      copy(transposed ? 3 : 1, transposed ? 1 : 3, step - kTile);
    } else if (transposed) {
      copy(3, 1, 0);
    } else {
      copy(1, 3, 0);
    }
  }
}

// A set of rows of a tile, in the form that suits the instruction set. `add_to_tile` adds contiguous numbers to these
// rows of a tile's column. It may read as many numbers as a tile has rows.
template <typename Scalar>
struct ChosenRows;
#if defined(__AVX2__)
// A byte for each row of a tile: the number of chosen rows before it, or -1 if it is not chosen itself.
struct RowsBefore {
  std::uint64_t of[1 << kTile] = {};
  constexpr RowsBefore() {
    for (std::uint64_t rows = 0; rows < 1 << kTile; ++rows) {
      std::uint64_t before = 0;
      for (int row = 0; row < kTile; ++row) of[rows] |= ((rows >> row & 1) != 0 ? before++ : 0xff) << 8 * row;
    }
  }
};
constexpr RowsBefore kRowsBefore;
SOFTHAND_INLINE __m128i rows_before(std::uint32_t rows) {
  return _mm_cvtsi64_si128(static_cast<long long>(kRowsBefore.of[rows]));
}
#endif
// A permutation of a loaded vector costs less than an expanding load (vexpandps).
#if defined(__AVX512F__)
template <>
struct ChosenRows<double> {
  __m512i before;
  __mmask8 mask;
  explicit ChosenRows(std::uint32_t rows)
      : before(_mm512_maskz_cvtepi8_epi64(0xff, rows_before(rows))), mask(static_cast<__mmask8>(rows)) {}
};
template <>
struct ChosenRows<float> {
  __m256i before;
  __mmask8 mask;
  explicit ChosenRows(std::uint32_t rows)
      : before(_mm256_cvtepi8_epi32(rows_before(rows))), mask(static_cast<__mmask8>(rows)) {}
};
SOFTHAND_INLINE void add_to_tile(double* to, const double* from, const ChosenRows<double>& chosen) {
  _mm512_store_pd(to, _mm512_add_pd(_mm512_load_pd(to),
                                    _mm512_maskz_permutexvar_pd(chosen.mask, chosen.before, _mm512_loadu_pd(from))));
}
SOFTHAND_INLINE void add_to_tile(float* to, const float* from, const ChosenRows<float>& chosen) {
  _mm256_store_ps(to, _mm256_add_ps(_mm256_load_ps(to),
                                    _mm256_maskz_permutexvar_ps(chosen.mask, chosen.before, _mm256_loadu_ps(from))));
}
#elif defined(__AVX2__)
template <>
struct ChosenRows<double> {
  __m256i pair[2];  // for each half of a tile: the sources of the two halves of each double
  __m256i none[2];
  int first;  // of the second half
  explicit ChosenRows(std::uint32_t rows) : first(__builtin_popcount(rows & 15)) {
    for (int half = 0; half < 2; ++half) {
      const __m256i before = _mm256_cvtepi8_epi64(rows_before(rows >> 4 * half & 15));
      const __m256i low = _mm256_add_epi64(before, before);
      pair[half] = _mm256_or_si256(low, _mm256_slli_epi64(_mm256_add_epi64(low, _mm256_set1_epi64x(1)), 32));
      none[half] = _mm256_cmpgt_epi64(_mm256_setzero_si256(), before);
    }
  }
};
template <>
struct ChosenRows<float> {
  __m256i before;
  explicit ChosenRows(std::uint32_t rows) : before(_mm256_cvtepi8_epi32(rows_before(rows))) {}
};
SOFTHAND_INLINE void add_to_tile(double* to, const double* from, const ChosenRows<double>& chosen) {
#pragma GCC unroll 2
  for (int half = 0; half < 2; ++half) {
    const __m256 spread = _mm256_permutevar8x32_ps(
        _mm256_castpd_ps(_mm256_loadu_pd(from + (half == 0 ? 0 : chosen.first))), chosen.pair[half]);
    const __m256d added = _mm256_andnot_pd(_mm256_castsi256_pd(chosen.none[half]), _mm256_castps_pd(spread));
    _mm256_store_pd(to + 4 * half, _mm256_add_pd(_mm256_load_pd(to + 4 * half), added));
  }
}
SOFTHAND_INLINE void add_to_tile(float* to, const float* from, const ChosenRows<float>& chosen) {
  const __m256 spread = _mm256_permutevar8x32_ps(_mm256_loadu_ps(from), chosen.before);
  const __m256 none = _mm256_castsi256_ps(_mm256_srai_epi32(chosen.before, 31));
  _mm256_store_ps(to, _mm256_add_ps(_mm256_load_ps(to), _mm256_andnot_ps(none, spread)));
}
#else
template <typename Scalar>
struct ChosenRows {
  std::uint32_t rows;
  explicit ChosenRows(std::uint32_t which) : rows(which) {}
};
template <typename Scalar>
SOFTHAND_INLINE void add_to_tile(Scalar* to, const Scalar* from, const ChosenRows<Scalar>& chosen) {
  for (std::uint32_t rows = chosen.rows; rows != 0; rows &= rows - 1) to[__builtin_ctz(rows)] += *from++;
}
#endif

// Adds the block columns [begin, end) of the child's update matrix to the parent. Columns that the parent eliminates go
// into its panel, the others into its update matrix.
template <typename Scalar, bool IntoPanel>
SOFTHAND_INLINE void extend_add(const CholeskyPlan& plan, const CholeskyFront& child, const Scalar* update,
                                std::int32_t begin, std::int32_t end, const CholeskyFront& parent, Scalar* target) {
  const std::int32_t* const in_parent = plan.row_in_parent + child.row_begin;
  const std::ptrdiff_t from_step = static_cast<std::ptrdiff_t>(child.row_tiles) * kTile;
  const std::ptrdiff_t tile_step = IntoPanel ? tile_step_of(parent) : kTile;
  const std::ptrdiff_t to_step = IntoPanel ? kTile : static_cast<std::ptrdiff_t>(parent.row_tiles) * kTile;
  const std::ptrdiff_t skipped = IntoPanel ? 0 : parent.pivot_tiles;  // tiles above the target's first
  const CholeskyTileRows* tile = plan.tile_rows + child.tile_begin;
  const CholeskyTileRows* const end_of_tiles = plan.tile_rows + child.tile_end;
  for (std::int32_t block = begin; block < end; ++block) {
    const std::int32_t row = in_parent[block];
    const Scalar* const from = update + 3 * block * from_step;
    Scalar* const to = target + (row - skipped * kTile) * to_step;
    const auto add = [&](int column, const CholeskyTileRows& rows, std::int32_t first,
                         const ChosenRows<Scalar>& chosen) {
      add_to_tile(to + column * to_step + (rows.tile - skipped) * tile_step, from + column * from_step + first, chosen);
    };
    while (tile->tile < row / kTile) ++tile;
    // From the diagonal down to the end of its tile. If a tile begins inside the block, the whole tile is below the
    // columns before it.
    for (int column = 0; column < 3; ++column) {
      const std::int32_t diagonal = row + column;
      if (tile->tile < diagonal / kTile) {
        ++tile;
        for (int before = 0; before < column; ++before) add(before, *tile, tile->first, ChosenRows<Scalar>(tile->rows));
      }
      add(column, *tile, 3 * block + column, ChosenRows<Scalar>(tile->rows & (~0u << (diagonal % kTile))));
    }
    for (const CholeskyTileRows* below = tile + 1; below != end_of_tiles; ++below) {
      const ChosenRows<Scalar> chosen(below->rows);
#pragma GCC unroll 3
      for (int column = 0; column < 3; ++column) add(column, *below, below->first, chosen);
    }
  }
}

template <typename Scalar>
bool factorize(const CholeskyPlan& plan, std::size_t begin, std::size_t end, const double* values, Scalar* panels,
               Scalar* updates, Scalar* inverse_diagonal) {
  for (std::size_t f = begin; f < end; ++f) {
    const CholeskyFront& front = plan.fronts[f];
    Scalar* const panel = panels + front.panel;
    const std::ptrdiff_t step = tile_step_of(front);
    const int tiles = front.pivot_tiles + front.row_tiles;
    assemble_entries(plan, front, values, panel);
    const auto eliminated_blocks = [&](const CholeskyFront& child) {
      std::int32_t count = 0;
      while (3 * count < child.rows && plan.row_in_parent[child.row_begin + count] < front.pivots) ++count;
      return count;
    };
    for (std::int32_t k = front.child_begin; k < front.child_end; ++k) {
      const CholeskyFront& child = plan.fronts[plan.child[k]];
      extend_add<Scalar, true>(plan, child, updates + child.update, 0, eliminated_blocks(child), front, panel);
    }
    for (int j = 0; j < front.pivot_tiles; ++j) {
      Scalar* const diagonal = panel + j * step + static_cast<std::ptrdiff_t>(j) * kTile * kTile;
      if (j > 0) {
        multiply<Scalar, true>(panel + j * step, step, tiles - j, panel + j * step,
                               static_cast<std::ptrdiff_t>(j) * kTile, diagonal, step, kTile);
      }
      Scalar inverse[kTile];
      if (!factorize_tile(diagonal, inverse)) return false;
      for (int c = 0; c < kTile && j * kTile + c < front.pivots; ++c)
        inverse_diagonal[front.first_pivot + j * kTile + c] = inverse[c];
      divide(diagonal + step, step, tiles - j - 1, diagonal, inverse);
    }
    // The update matrix is written first, and those of the children are added later. So it need not be cleared.
    Scalar* const update = updates + front.update;
    const Scalar* const below = panel + front.pivot_tiles * step;
    const std::ptrdiff_t height = static_cast<std::ptrdiff_t>(front.row_tiles) * kTile;
    for (int j = 0; j < front.row_tiles; ++j) {
      multiply<Scalar, false>(below + j * step, step, front.row_tiles - j, below + j * step, front.pivots,
                              update + j * kTile * (height + 1), kTile, height);
    }
    for (std::int32_t k = front.child_begin; k < front.child_end; ++k) {
      const CholeskyFront& child = plan.fronts[plan.child[k]];
      extend_add<Scalar, false>(plan, child, updates + child.update, eliminated_blocks(child), child.rows / 3, front,
                                update);
    }
  }
  return true;
}

}  // namespace
}  // namespace softhand

#include "solver/block_cholesky_solve_source.hpp"
#include "solver/compliance_kernel_source.hpp"

#undef SOFTHAND_INLINE
