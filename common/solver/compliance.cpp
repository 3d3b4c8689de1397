#include "solver/compliance.hpp"

#include <algorithm>
#include <cmath>

#include "math/index.hpp"

namespace softhand {
namespace {

constexpr std::size_t kTile = kCholeskyTile;
// Time of a floating-point operation of the kernels here, in operations of a factorisation in float.
constexpr double kOperation = 0.7;

std::size_t tiles_of(std::size_t columns) { return (columns + kTile - 1) / kTile; }

}  // namespace

Compliance::Compliance(int core_count, int most_blocks, InstructionSet set)
    : most_blocks_(std::min(most_blocks, core_count)),
      kernel_(cholesky_kernel<double>(set)),
      rows_(3 * core_count),
      // A sixth more for tiles that are not full.
      most_tiles_(tiles_of(at(7 * most_blocks_ / 2)) + 1),
      step_(static_cast<std::ptrdiff_t>(most_tiles_ * kTile * kTile)),
      is_known_(at(core_count), 0),
      factor_(most_tiles_ * most_tiles_ * kTile),
      inverse_diagonal_(most_tiles_ * kTile),
      inverse_(factor_.size()),
      gram_(factor_.size()),
      stiffness_(Dense::Zero(3 * most_blocks_, 3 * most_blocks_)),
      columns_of_x_(most_tiles_),
      columns_of_y_(most_tiles_) {
  for (auto* list : {&blocks_, &pending_}) list->reserve(at(most_blocks_));
  first_column_.reserve(at(most_blocks_));
  columns_.reserve(most_tiles_);
  // A path to the root holds an eighth of all rows in the shipped hands.
  ranges_.reserve(at(core_count) * most_tiles_ / 3);
  v_.reserve(at(core_count) * at(most_blocks_) / 4);
  half_columns_.values.setZero(rows_, kColumns);
  half_columns_.ranges.reserve(at(core_count));
  selection_.reserve(kTile);
}

void Compliance::clear() {
  for (const std::int32_t block : blocks_) is_known_[at(block)] = 0;
  blocks_.clear();
  first_column_.clear();
  columns_.clear();
  ranges_.clear();
  v_.clear();
}

bool Compliance::include(std::span<const std::int32_t> blocks, LinearSolver& factor) {
  if (blocks.empty()) return true;
  if (blocks.size() > room()) return false;
  pending_.clear();
  if (columns_.size() + tiles_of(3 * blocks.size()) > most_tiles_) {
    // Too many tiles are not full: begin again with all blocks.
    pending_.assign(blocks_.begin(), blocks_.end());
    clear();
  }
  pending_.insert(pending_.end(), blocks.begin(), blocks.end());
  const std::size_t first_tile = columns_.size();
  append_columns(pending_, factor);
  if (!extend(first_tile)) {
    clear();
    return false;
  }
  store_stiffness();
  return true;
}

// Appends the columns of V of these blocks.
void Compliance::append_columns(std::span<const std::int32_t> blocks, LinearSolver& factor) {
  static_assert(kColumns == kCholeskyTile);
  const double entries_per_row = factor.factor_entries() / static_cast<double>(rows_);
  const std::size_t first = columns_.size() * kTile;
  for (std::size_t k = 0; k < blocks.size(); ++k) {
    blocks_.push_back(blocks[k]);
    first_column_.push_back(first + 3 * k);
    is_known_[at(blocks[k])] = 1;
  }
  for (std::size_t column = 0; column < 3 * blocks.size(); column += kTile) {
    selection_.clear();
    const std::size_t end = std::min(column + kTile, 3 * blocks.size());
    for (std::size_t c = column; c < end; ++c) {
      if (selection_.empty() || c % 3 == 0) {
        selection_.emplace_back().block = blocks[c / 3];
        selection_.back().values.setZero();
      }
      selection_.back().values(static_cast<Eigen::Index>(c % 3), static_cast<Eigen::Index>(c - column)) = 1;
    }
    factor.forward_columns(selection_, half_columns_);
    Columns& columns = columns_.emplace_back();
    columns.first_range = ranges_.size();
    columns.first_row = v_.size();
    for (const auto& [begin, range_end] : half_columns_.ranges) {
      ranges_.emplace_back(begin, range_end);
      for (Eigen::Index row = begin; row < range_end; ++row)
        Eigen::Map<Eigen::Matrix<double, 1, kColumns>>(v_.emplace_back().values) = half_columns_.values.row(row);
    }
    columns.last_range = ranges_.size();
    operations_ += 2 * kColumns * entries_per_row * static_cast<double>(v_.size() - columns.first_row);
  }
}

// Writes the tile row of G = V' V for a tile of V.
void Compliance::multiply_columns(std::size_t tile) {
  const Columns& own = columns_[tile];
  double rows = 0;
  for (std::size_t k = 0; k <= tile; ++k) {
    const Columns& other = columns_[k];
    Row* const product = factor_.data() + (tile * most_tiles_ + k) * kTile;
    std::fill_n(product, kTile, Row{});
    const Row *a = v_.data() + own.first_row, *b = v_.data() + other.first_row;
    for (std::size_t i = own.first_range, j = other.first_range; i < own.last_range && j < other.last_range;) {
      const auto [a_begin, a_end] = ranges_[i];
      const auto [b_begin, b_end] = ranges_[j];
      const std::int32_t begin = std::max(a_begin, b_begin), end = std::min(a_end, b_end);
      if (begin < end) {
        kernel_.subtract_products(a[begin - a_begin].values, b[begin - b_begin].values, end - begin, product->values);
        rows += end - begin;
      }
      if (a_end < b_end) {
        a += a_end - a_begin;
        ++i;
      } else {
        b += b_end - b_begin;
        ++j;
      }
    }
    for (std::size_t c = 0; c < kTile; ++c) {
      for (double& value : product[c].values) value = -value;
    }
  }
  operations_ += kOperation * 2 * kTile * kTile * rows;
}

// Extends G, its factor, the inverse of this and -S by the tiles from `first` on.
bool Compliance::extend(std::size_t first) {
  const std::size_t end = columns_.size();
  for (std::size_t tile = first; tile < end; ++tile) multiply_columns(tile);
  for (std::size_t c = first_column_.back() + 3; c < end * kTile; ++c)
    factor_[((end - 1) * most_tiles_ + end - 1) * kTile + c % kTile].values[c % kTile] = 1;
  const auto first_row = static_cast<std::int32_t>(first), end_row = static_cast<std::int32_t>(end);
  if (!kernel_.extend_factor(first_row, end_row, step_, factor_[0].values, inverse_diagonal_.data())) return false;
  kernel_.extend_inverse(first_row, end_row, step_, factor_[0].values, inverse_diagonal_.data(), inverse_[0].values);
  kernel_.extend_gram(first_row, end_row, step_, inverse_[0].values, gram_[0].values);
  const auto cube = [](std::size_t tiles) { return std::pow(static_cast<double>(kTile * tiles), 3); };
  operations_ += kOperation * (cube(end) - cube(first));
  return true;
}

void Compliance::store_stiffness() {
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    for (std::size_t r = 0; r < 3; ++r) {
      const std::size_t row = first_column_[i] + r;
      const double* const from = gram_[row / kTile * most_tiles_ * kTile].values + row % kTile;
      double* to = &stiffness_(static_cast<Eigen::Index>(3 * i + r), 0);
      for (std::size_t j = 0; j < i; ++j) {
        const double* const block = from + first_column_[j] * kTile;
        for (std::size_t c = 0; c < 3; ++c) *to++ = -block[c * kTile];
      }
      for (std::size_t c = 0; c <= r; ++c) *to++ = -from[(first_column_[i] + c) * kTile];
    }
  }
}

// Calls visit(first row, rows of the tile, their count) for the ranges of a tile of V.
template <typename Visit>
void Compliance::for_each_range(const Columns& columns, Visit&& visit) const {
  const Row* row = v_.data() + columns.first_row;
  for (std::size_t i = columns.first_range; i < columns.last_range; ++i) {
    const auto [begin, end] = ranges_[i];
    visit(begin, row->values, end - begin);
    row += end - begin;
  }
}

// From the order of `blocks_` to that of the columns, and back for the blocks from `first` on.
void Compliance::spread(const Eigen::Ref<const VectorX>& values, Row* columns) const {
  std::fill_n(columns, columns_.size(), Row{});
  for (std::size_t k = 0; k < blocks_.size(); ++k)
    Eigen::Map<Vector3>(columns->values + first_column_[k]) = values.segment<3>(3 * static_cast<Eigen::Index>(k));
}
void Compliance::gather(const Row* columns, std::size_t first, Eigen::Ref<VectorX> values) const {
  for (std::size_t k = first; k < blocks_.size(); ++k)
    values.segment<3>(3 * static_cast<Eigen::Index>(k - first)) =
        Eigen::Map<const Vector3>(columns->values + first_column_[k]);
}

void Compliance::find_displacements(std::size_t first, const VectorX& half, Eigen::Ref<VectorX> displacements) {
  if (first == blocks_.size()) return;
  for (std::size_t tile = first_column_[first] / kTile; tile < columns_.size(); ++tile) {
    Row& sums = columns_of_y_[tile] = {};
    for_each_range(columns_[tile], [&](std::int32_t begin, const double* rows, std::int32_t count) {
      kernel_.add_transposed(rows, half.data() + begin, count, sums.values);
    });
  }
  gather(columns_of_y_.data(), first, displacements);
}

void Compliance::add_forces(const Eigen::Ref<const VectorX>& forces, VectorX& half) {
  spread(forces, columns_of_x_.data());
  for (std::size_t tile = 0; tile < columns_.size(); ++tile) {
    const Row& factors = columns_of_x_[tile];
    if (Eigen::Map<const Eigen::Matrix<double, kTile, 1>>(factors.values).isZero(0)) continue;
    for_each_range(columns_[tile], [&](std::int32_t begin, const double* rows, std::int32_t count) {
      kernel_.add_columns(rows, factors.values, count, half.data() + begin);
    });
  }
}

void Compliance::multiply_stiffness(const Eigen::Ref<const VectorX>& x, Eigen::Ref<VectorX> product) {
  spread(x, columns_of_x_.data());
  std::fill_n(columns_of_y_.data(), columns_.size(), Row{});
  kernel_.subtract_symmetric(static_cast<std::int32_t>(columns_.size()), step_, gram_[0].values,
                             columns_of_x_[0].values, columns_of_y_[0].values);
  gather(columns_of_y_.data(), 0, product);
}

}  // namespace softhand
