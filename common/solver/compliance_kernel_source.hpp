// The kernels of Compliance, on tiles of columns. Only block_cholesky_kernel_source.hpp includes this.
#pragma once

namespace softhand {
namespace {

template <typename Scalar>
void subtract_products(const Scalar* a, const Scalar* b, std::int32_t rows, Scalar* sums) {
  multiply<Scalar, true>(a, 0, 1, b, rows, sums, 0, kTile);
}

// V of a large mesh is larger than the second-level cache. Its rows are read one after another, tile after tile. They
// are prefetched so many rows ahead, also across the end of a tile.
constexpr int kRowsAhead = 128;

template <typename Scalar>
void add_transposed(const Scalar* a, const Scalar* x, std::int32_t rows, Scalar* sums) {
  using S = Shape<Scalar>;
  // Two sums, because an addition waits for the one before.
  typename S::Vector sum[2][S::kParts] = {};
  for (std::int32_t r = 0; r < rows; ++r) {
    prefetch<kTile, kSecondCache>(a + (r + kRowsAhead) * kTile);
    for (int k = 0; k < S::kParts; ++k) sum[r % 2][k] += vector_at(a + r * kTile + k * S::kWidth) * x[r];
  }
  for (int k = 0; k < S::kParts; ++k) vector_at(sums + k * S::kWidth) += sum[0][k] + sum[1][k];
}

template <typename Scalar>
void add_columns(const Scalar* a, const Scalar* factors, std::int32_t rows, Scalar* y) {
  using S = Shape<Scalar>;
  using Vector = typename S::Vector;
  const auto product = [&](std::int32_t r) {
    prefetch<kTile, kSecondCache>(a + (r + kRowsAhead) * kTile);
    Vector sum = vector_at(a + r * kTile) * vector_at(factors);
    for (int k = 1; k < S::kParts; ++k)
      sum += vector_at(a + r * kTile + k * S::kWidth) * vector_at(factors + k * S::kWidth);
    return sum;
  };
  std::int32_t r = 0;
  for (; r + S::kWidth <= rows; r += S::kWidth) {
    Vector products[S::kWidth];
    for (int k = 0; k < S::kWidth; ++k) products[k] = product(r + k);
    *reinterpret_cast<typename S::Unaligned*>(y + r) += sums_of<Scalar>(products);
  }
  for (; r < rows; ++r) y[r] += sum_of(product(r));
}

template <typename Scalar>
bool extend_factor(std::int32_t first, std::int32_t end, std::ptrdiff_t step, Scalar* factor,
                   Scalar* inverse_diagonal) {
  for (std::ptrdiff_t j = 0; j < end; ++j) {
    const bool is_new = j >= first;
    const std::ptrdiff_t begin = is_new ? j : first, column = j * kTile * kTile;
    const Scalar* const other = factor + j * step;
    Scalar* const inverse = inverse_diagonal + j * kTile;
    if (j > 0) {
      multiply<Scalar, true>(factor + begin * step, step, static_cast<int>(end - begin), other, j * kTile,
                             factor + begin * step + column, step, kTile);
    }
    if (is_new && !factorize_tile(factor + j * step + column, inverse)) return false;
    const std::ptrdiff_t below = is_new ? j + 1 : first;
    divide(factor + below * step + column, step, static_cast<int>(end - below), other + column, inverse);
  }
  return true;
}

// Tile rows that the product kernel takes together.
constexpr std::ptrdiff_t kGroup = 3;

template <typename Scalar>
void extend_inverse(std::int32_t first, std::int32_t end, std::ptrdiff_t step, const Scalar* factor,
                    const Scalar* inverse_diagonal, Scalar* inverse) {
  for (std::ptrdiff_t i = first; i < end; ++i) {
    const std::ptrdiff_t column = i * kTile * kTile;
    const Scalar* const own = factor + i * step;
    // M' is upper triangular: its tile row j is zero before tile j. So the products of a group begin at the tile of its
    // first row.
    for (std::ptrdiff_t j = 0; j < i; j += kGroup) {
      const std::ptrdiff_t tiles = i - j < kGroup ? i - j : kGroup, begin = j * kTile * kTile;
      multiply<Scalar, false>(inverse + j * step + begin, step, static_cast<int>(tiles), own + begin, (i - j) * kTile,
                              inverse + j * step + column, step, kTile);
    }
    Scalar* const diagonal = inverse + i * step + column;
    for (int k = 0; k < kTile * kTile; ++k) diagonal[k] = Scalar(k % (kTile + 1) == 0 ? 1 : 0);
    divide(inverse + column, step, static_cast<int>(i) + 1, own + column, inverse_diagonal + i * kTile);
  }
}

template <typename Scalar>
void extend_gram(std::int32_t first, std::int32_t end, std::ptrdiff_t step, const Scalar* inverse, Scalar* gram) {
  for (std::ptrdiff_t b = 0; b < end; ++b) {
    const Scalar* const other = inverse + b * step;
    for (std::ptrdiff_t a = b, tiles = 0; a < end; a += tiles) {
      const bool is_new = a >= first;
      const std::ptrdiff_t remaining = (is_new ? end : first) - a;
      tiles = remaining < kGroup ? remaining : kGroup;
      const std::ptrdiff_t begin = is_new ? a : first, skipped = begin * kTile * kTile;
      Scalar* const sums = gram + a * step + b * kTile * kTile;
      const auto product = is_new ? multiply<Scalar, false> : multiply<Scalar, true>;
      product(inverse + a * step + skipped, step, static_cast<int>(tiles), other + skipped, (end - begin) * kTile, sums,
              step, kTile);
    }
  }
}

template <typename Scalar>
void subtract_symmetric(std::int32_t end, std::ptrdiff_t step, const Scalar* matrix, const Scalar* x, Scalar* y) {
  using S = Shape<Scalar>;
  using Vector = typename S::Vector;
  for (std::ptrdiff_t i = 0; i < end; ++i) {
    const Scalar* const own = x + i * kTile;
    Vector sum[S::kParts] = {};
    for (std::ptrdiff_t j = 0; j <= i; ++j) {
      const Scalar* const tile = matrix + i * step + j * kTile * kTile;
      for (int c = 0; c < kTile; ++c) {
        Vector product{};
        for (int k = 0; k < S::kParts; ++k) {
          const Vector column = vector_at(tile + c * kTile + k * S::kWidth);
          sum[k] += column * x[j * kTile + c];
          product += column * vector_at(own + k * S::kWidth);
        }
        if (j < i) y[j * kTile + c] -= sum_of(product);
      }
    }
    for (int k = 0; k < S::kParts; ++k) vector_at(y + i * kTile + k * S::kWidth) -= sum[k];
  }
}

}  // namespace
}  // namespace softhand
