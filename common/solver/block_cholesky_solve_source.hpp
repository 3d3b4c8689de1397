// The kernels of the solves with a factor. Only block_cholesky_kernel_source.hpp includes this.
#pragma once

namespace softhand {
namespace {

// The solves read each tile of the factor once. Those of a large mesh wait for memory, so they ask for a tile this many
// tiles before they read it.
constexpr int kAhead = 12;
// `backward` jumps from tile row to tile row, which the hardware prefetcher does not follow. So it prefetches much
// earlier.
constexpr int kAheadOfJumps = 64;
// Locality arguments of __builtin_prefetch. The first-level cache has no room for what is prefetched so early.
constexpr int kFirstCache = 3, kSecondCache = 2;

template <int kCount, int kCache, typename Scalar>
SOFTHAND_INLINE void prefetch(const Scalar* at) {
  constexpr int kCacheLine = 64 / static_cast<int>(sizeof(Scalar));
  for (int i = 0; i < kCount; i += kCacheLine) __builtin_prefetch(at + i, 0, kCache);
}

template <typename Scalar>
void forward(const CholeskyPlan& plan, const Scalar* panels, const Scalar* inverse_diagonal, Scalar* x,
             Scalar* scratch) {
  using S = Shape<Scalar>;
  using Vector = typename S::Vector;
  for (std::size_t f = 0; f < plan.front_count; ++f) {
    const CholeskyFront& front = plan.fronts[f];
    const std::ptrdiff_t step = tile_step_of(front);
    const Scalar* const panel = panels + front.panel;
    Scalar* const pivot = x + front.first_pivot;
    const Scalar* const inverse = inverse_diagonal + front.first_pivot;
    const int tiles = front.pivot_tiles + front.row_tiles;
    // Tile by tile: the contribution of the solved pivots before the tile, then the triangle on the diagonal.
    for (int t = 0; t < tiles; ++t) {
      const bool on_diagonal = t < front.pivot_tiles;
      const std::int32_t depth = on_diagonal ? t * kTile : front.pivots;
      const Scalar* const tile = panel + t * step;
      Vector sum[2][S::kParts] = {};
      std::int32_t p = 0;
      for (; p + 2 <= depth; p += 2) {
        prefetch<2 * kTile, kFirstCache>(tile + p * kTile + kAhead * kTile * kTile);
        for (int half = 0; half < 2; ++half) {
          for (int k = 0; k < S::kParts; ++k)
            sum[half][k] += vector_at(tile + (p + half) * kTile + k * S::kWidth) * pivot[p + half];
        }
      }
      if (p < depth) {
        for (int k = 0; k < S::kParts; ++k) sum[0][k] += vector_at(tile + p * kTile + k * S::kWidth) * pivot[p];
      }
      Scalar* const taken = scratch + (on_diagonal ? 0 : (t - front.pivot_tiles) * kTile);
      for (int k = 0; k < S::kParts; ++k) vector_at(taken + k * S::kWidth) = sum[0][k] + sum[1][k];
      if (!on_diagonal) continue;
      const int width = front.pivots - depth < kTile ? front.pivots - depth : kTile;
      for (int c = 0; c < width; ++c) {
        Scalar value = pivot[depth + c] - taken[c];
        for (int q = 0; q < c; ++q) value -= tile[(depth + q) * kTile + c] * pivot[depth + q];
        pivot[depth + c] = value * inverse[depth + c];
      }
    }
    for (std::int32_t b = 0; b < front.rows / 3; ++b) {
      Scalar* const row = x + plan.row_position[front.row_begin + b];
      for (int r = 0; r < 3; ++r) row[r] -= scratch[3 * b + r];
    }
  }
}

// As `forward`, for kTile right-hand sides at once. The products are those of the factorisation, with the right-hand
// sides as the second operand.
template <typename Scalar>
void forward_columns(const CholeskyPlan& plan, const std::uint8_t* included, const Scalar* panels,
                     const Scalar* inverse_diagonal, Scalar* x, Scalar* scratch) {
  using S = Shape<Scalar>;
  for (std::size_t f = 0; f < plan.front_count; ++f) {
    if (included[f] == 0) continue;
    const CholeskyFront& front = plan.fronts[f];
    const std::ptrdiff_t step = tile_step_of(front);
    const Scalar* const panel = panels + front.panel;
    Scalar* const pivot = x + static_cast<std::ptrdiff_t>(front.first_pivot) * kTile;
    const Scalar* const inverse = inverse_diagonal + front.first_pivot;
    for (int t = 0; t < front.pivot_tiles; ++t) {
      const std::int32_t depth = t * kTile;
      const Scalar* const tile = panel + t * step;
      const int width = front.pivots - depth < kTile ? front.pivots - depth : kTile;
      if (depth > 0) {
        multiply<Scalar, false>(tile, step, 1, pivot, depth, scratch, kTile, kTile);
        for (int r = 0; r < width; ++r) {
          for (int j = 0; j < kTile; ++j) pivot[(depth + r) * kTile + j] += scratch[j * kTile + r];
        }
      }
      for (int c = 0; c < width; ++c) {
        Scalar* const row = pivot + (depth + c) * kTile;
        for (int q = 0; q < c; ++q) {
          const Scalar factor = tile[(depth + q) * kTile + c];
          for (int k = 0; k < kTile; k += S::kWidth)
            vector_at(row + k) -= factor * vector_at(row + k - (c - q) * kTile);
        }
        for (int k = 0; k < kTile; k += S::kWidth) vector_at(row + k) *= inverse[depth + c];
      }
    }
    const std::ptrdiff_t height = static_cast<std::ptrdiff_t>(front.row_tiles) * kTile;
    multiply<Scalar, false>(panel + front.pivot_tiles * step, step, front.row_tiles, pivot, front.pivots, scratch,
                            kTile, height);
    for (std::int32_t b = 0; b < front.rows / 3; ++b) {
      Scalar* const to = x + static_cast<std::ptrdiff_t>(plan.row_position[front.row_begin + b]) * kTile;
      for (int r = 0; r < 3; ++r) {
        for (int j = 0; j < kTile; ++j) to[r * kTile + j] += scratch[j * height + 3 * b + r];
      }
    }
  }
}

// The tiles in the order in which `backward` reads them. It goes through the fronts from the last one to the first, and
// so through the tile columns of a front. Each column goes from the diagonal down.
template <typename Scalar>
class BackwardTiles {
 public:
  BackwardTiles(const CholeskyPlan& plan, const Scalar* panels)
      : plan_(plan), panels_(panels), front_(plan.front_count) {
    next_front();
    for (int k = 0; k < kAheadOfJumps; ++k) next();
  }
  SOFTHAND_INLINE void next() {
    prefetch<kTile * kTile, kSecondCache>(tile_);
    tile_ += step_;
    if (tile_ < end_) return;
    if (column_ > 0) {
      --column_;
      end_ -= kTile * kTile;
      tile_ = diagonal_ -= step_ + kTile * kTile;
    } else {
      next_front();
    }
  }

 private:
  void next_front() {
    if (front_ == 0) {
      step_ = 0;
      return;
    }
    const CholeskyFront& front = plan_.fronts[--front_];
    step_ = tile_step_of(front);
    column_ = front.pivot_tiles - 1;
    tile_ = diagonal_ = panels_ + front.panel + column_ * (step_ + kTile * kTile);
    end_ = panels_ + front.panel + (front.pivot_tiles + front.row_tiles) * step_ + column_ * kTile * kTile;
  }

  const CholeskyPlan& plan_;
  const Scalar* panels_;
  std::size_t front_;
  int column_ = 0;
  std::ptrdiff_t step_ = 0;
  const Scalar *tile_ = nullptr, *diagonal_ = nullptr, *end_ = nullptr;
};

template <typename Scalar>
void backward(const CholeskyPlan& plan, const Scalar* panels, const Scalar* inverse_diagonal, Scalar* x,
              Scalar* scratch) {
  using S = Shape<Scalar>;
  using Vector = typename S::Vector;
  BackwardTiles<Scalar> ahead(plan, panels);
  for (std::size_t f = plan.front_count; f-- > 0;) {
    const CholeskyFront& front = plan.fronts[f];
    const std::ptrdiff_t step = tile_step_of(front);
    const Scalar* const panel = panels + front.panel;
    Scalar* const pivot = x + front.first_pivot;
    const Scalar* const inverse = inverse_diagonal + front.first_pivot;
    const std::int32_t first_row = front.pivot_tiles * kTile;
    const int tiles = front.pivot_tiles + front.row_tiles;
    // The front's part of x with its padding as zeros.
    for (std::int32_t r = front.pivots; r < first_row; ++r) scratch[r] = Scalar(0);
    for (std::int32_t b = 0; b < front.rows / 3; ++b) {
      const Scalar* const row = x + plan.row_position[front.row_begin + b];
      for (int r = 0; r < 3; ++r) scratch[first_row + 3 * b + r] = row[r];
    }
    for (std::int32_t r = front.rows; r < front.row_tiles * kTile; ++r) scratch[first_row + r] = Scalar(0);
    for (int j = front.pivot_tiles; j-- > 0;) {
      const std::int32_t first = j * kTile;
      const int width = front.pivots - first < kTile ? front.pivots - first : kTile;
      ahead.next();
      Vector sum[kTile][S::kParts] = {};
      for (int t = j + 1; t < tiles; ++t) {
        ahead.next();
        const Scalar* const tile = panel + t * step + first * kTile;
        for (int k = 0; k < S::kParts; ++k) {
          const Vector below = vector_at(scratch + t * kTile + k * S::kWidth);
#pragma GCC unroll 8
          for (int c = 0; c < kTile; ++c) sum[c][k] += vector_at(tile + c * kTile + k * S::kWidth) * below;
        }
      }
      alignas(64) Scalar sums[kTile];
      for (int c = 0; c < kTile; c += S::kWidth) {
        Vector columns[S::kWidth];
        for (int i = 0; i < S::kWidth; ++i) {
          columns[i] = sum[c + i][0];
          for (int k = 1; k < S::kParts; ++k) columns[i] += sum[c + i][k];
        }
        vector_at(sums + c) = sums_of<Scalar>(columns);
      }
      const Scalar* const diagonal = panel + j * step + first * kTile;
      for (int c = width; c-- > 0;) {
        Scalar value = pivot[first + c] - sums[c];
        for (int q = c + 1; q < width; ++q) value -= diagonal[c * kTile + q] * scratch[first + q];
        pivot[first + c] = scratch[first + c] = value * inverse[first + c];
      }
    }
  }
}

}  // namespace
}  // namespace softhand
