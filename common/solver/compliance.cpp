#include "solver/compliance.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace softhand {
namespace {

constexpr std::size_t kPassBlocks = kColumns / 3;  // blocks in one pass over the factor
constexpr std::int32_t kTile = kCholeskyTile;
// Time of the product of two tiles, in operations of a factorisation in float; and that of its sums, in tiles.
constexpr double kTileOperations = 120;
constexpr double kSumTiles = 8;

using TileMatrix = Eigen::Matrix<double, kTile, 3>;

std::int32_t tile_rows_of(std::int32_t rows) { return (rows + kTile - 1) / kTile; }
// The tile with the first column of a block, and the number of tiles with columns of earlier blocks.
Eigen::Index first_tile(std::size_t place) { return static_cast<Eigen::Index>(3 * place / kTile); }
Eigen::Index tiles_before(std::size_t place) { return static_cast<Eigen::Index>((3 * place + kTile - 1) / kTile); }

// Products of two groups of three columns, lane by lane.
struct Sums {
  alignas(64) double lanes[9 * kTile] = {};
  Matrix3 total() const {
    Matrix3 result;
    Eigen::Map<Eigen::RowVectorXd>(result.data(), 9) =
        Eigen::Map<const Eigen::Matrix<double, kTile, 9>>(lanes).colwise().sum();
    return result;
  }
};

}  // namespace

Compliance::Compliance(int core_count, int most_blocks, InstructionSet set)
    : most_blocks_(std::min(most_blocks, core_count)),
      kernel_(cholesky_kernel<double>(set)),
      rows_(3 * core_count),
      tiles_per_row_(static_cast<std::size_t>(tile_rows_of(3 * most_blocks_))),
      is_known_(static_cast<std::size_t>(core_count), 0),
      factor_(static_cast<std::size_t>(most_blocks_) * tiles_per_row_),
      inverse_diagonal_(static_cast<std::size_t>(most_blocks_)),
      inverse_(factor_.size()),
      stiffness_(Dense::Zero(3 * most_blocks_, 3 * most_blocks_)) {
  blocks_.reserve(static_cast<std::size_t>(most_blocks_));
  columns_.reserve(static_cast<std::size_t>(most_blocks_));
  // A path to the root holds an eighth of all rows in the shipped hands.
  ranges_.reserve(static_cast<std::size_t>(core_count) * static_cast<std::size_t>(most_blocks_) / 8);
  tiles_.reserve(static_cast<std::size_t>(core_count) * static_cast<std::size_t>(most_blocks_) / 10);
  half_columns_.values.setZero(tile_rows_of(3 * core_count) * kTile, kColumns);
  half_columns_.ranges.reserve(static_cast<std::size_t>(core_count));
  selection_.reserve(kPassBlocks);
}

void Compliance::clear() {
  for (const std::int32_t block : blocks_) is_known_[static_cast<std::size_t>(block)] = 0;
  blocks_.clear();
  columns_.clear();
  ranges_.clear();
  tiles_.clear();
  known_ = 0;
}

bool Compliance::include(std::span<const std::int32_t> blocks, LinearSolver& factor) {
  if (blocks.empty()) return true;
  if (blocks_.size() + blocks.size() > static_cast<std::size_t>(most_blocks_)) {
    return false;
  }
  const double entries_per_row = factor.factor_entries() / static_cast<double>(rows_);
  for (std::size_t first = 0; first < blocks.size(); first += kPassBlocks) {
    const std::size_t count = std::min(kPassBlocks, blocks.size() - first);
    selection_.clear();
    for (std::size_t k = 0; k < count; ++k) {
      ColumnsRow& row = selection_.emplace_back();
      row.block = blocks[first + k];
      row.values.setZero();
      row.values.middleCols<3>(3 * static_cast<Eigen::Index>(k)).setIdentity();
    }
    factor.forward_columns(selection_, half_columns_);
    double rows = 0;
    for (const auto& [begin, end] : half_columns_.ranges) rows += end - begin;
    operations_ += 2 * kColumns * entries_per_row * rows;
    for (std::size_t k = 0; k < count; ++k) {
      append_columns(3 * static_cast<Eigen::Index>(k));
      blocks_.push_back(blocks[first + k]);
      is_known_[static_cast<std::size_t>(blocks[first + k])] = 1;
    }
    // Tiles have rows outside the ranges too. These must be zero.
    for (const auto& [begin, end] : half_columns_.ranges) half_columns_.values.middleRows(begin, end - begin).setZero();
  }
  if (extend()) return true;
  clear();
  return false;
}

// Stores three of `half_columns_` as the columns of a new block. The values outside the ranges of rows are zero.
void Compliance::append_columns(Eigen::Index first_column) {
  Columns& columns = columns_.emplace_back();
  columns.first_range = ranges_.size();
  columns.tiles = tiles_.size();
  const auto part = [&](std::int32_t tile) {
    return half_columns_.values.block<kTile, 3>(static_cast<Eigen::Index>(tile) * kTile, first_column);
  };
  std::int32_t stored = 0;
  for (const auto& [first_row, last_row] : half_columns_.ranges) {
    std::int32_t begin = std::max(stored, first_row / kTile);
    const std::int32_t end = tile_rows_of(last_row);
    // The rows before the block's own front belong to another block of the group.
    while (begin < end && part(begin).isZero(0)) ++begin;
    stored = end;
    if (begin == end) continue;
    ranges_.emplace_back(begin, end);
    for (std::int32_t tile = begin; tile < end; ++tile)
      Eigen::Map<TileMatrix>(tiles_.emplace_back().values[0]) = part(tile);
  }
  columns.last_range = ranges_.size();
}

Matrix3 Compliance::product(const Tile* a, const Tile* b, Eigen::Index tiles) {
  Sums sums;
  kernel_.add_products(a->values[0], b->values[0], static_cast<std::int32_t>(tiles), sums.lanes);
  operations_ += kTileOperations * (static_cast<double>(tiles) + kSumTiles);
  return sums.total();
}

// V_a' V_b over their common rows.
Matrix3 Compliance::product(const Columns& a, const Columns& b) {
  Sums sums;
  const Tile *at_a = tiles_.data() + a.tiles, *at_b = tiles_.data() + b.tiles;
  std::int32_t tiles = 0;
  for (std::size_t i = a.first_range, j = b.first_range; i < a.last_range && j < b.last_range;) {
    const auto [a_begin, a_end] = ranges_[i];
    const auto [b_begin, b_end] = ranges_[j];
    const std::int32_t begin = std::max(a_begin, b_begin), end = std::min(a_end, b_end);
    if (begin < end) {
      kernel_.add_products(at_a[begin - a_begin].values[0], at_b[begin - b_begin].values[0], end - begin, sums.lanes);
      tiles += end - begin;
    }
    if (a_end < b_end) {
      at_a += a_end - a_begin;
      ++i;
    } else {
      at_b += b_end - b_begin;
      ++j;
    }
  }
  operations_ += kTileOperations * (tiles + kSumTiles);
  return sums.total();
}

// Extends the factor of G, its inverse and S by the blocks that were added.
bool Compliance::extend() {
  const auto write = [](Tile* to, std::size_t place, const Matrix3& block) {
    for (std::size_t c = 0; c < 3; ++c) {
      const std::size_t column = 3 * place + c;
      for (int r = 0; r < 3; ++r) to[column / kTile].values[r][column % kTile] = block(r, static_cast<Eigen::Index>(c));
    }
  };
  for (std::size_t i = known_; i < blocks_.size(); ++i) {
    // Rows are zero where they are not computed yet. So products may take whole tiles.
    Tile *const own = row(factor_, i), *const own_inverse = row(inverse_, i);
    std::fill_n(own, tiles_per_row_, Tile{});
    std::fill_n(own_inverse, tiles_per_row_, Tile{});
    for (std::size_t j = 0; j < i; ++j) {
      const Matrix3 rest = product(columns_[i], columns_[j]) - product(own, row(factor_, j), tiles_before(j));
      write(own, j, rest * inverse_diagonal_[j].transpose());
    }
    const Eigen::LLT<Matrix3> diagonal(product(columns_[i], columns_[i]) - product(own, own, tiles_before(i)));
    if (diagonal.info() != Eigen::Success || !diagonal.matrixLLT().allFinite()) return false;
    const Matrix3 inverse = inverse_diagonal_[i] = diagonal.matrixL().solve(Matrix3::Identity());
    for (std::size_t j = 0; j < i; ++j) {
      Tile* const other = row(inverse_, j);
      const Eigen::Index first = first_tile(j);
      write(other, i, (-inverse * product(own + first, other + first, tiles_before(i) - first)).transpose());
    }
    write(own, i, diagonal.matrixL());
    write(own_inverse, i, inverse.transpose());
  }
  extend_stiffness();
  known_ = blocks_.size();
  return true;
}

// S grows by the products of the inverse over the new columns.
void Compliance::extend_stiffness() {
  const Eigen::Index end = tiles_before(blocks_.size());
  const auto known = static_cast<int>(3 * known_ % kTile);  // columns of the first tile that are not new
  for (std::size_t i = 0; i < blocks_.size(); ++i) {
    const Tile* const own = row(inverse_, i);
    const bool is_new = i >= known_;
    const Eigen::Index first = first_tile(std::max(i, known_));
    const bool has_mixed_tile = !is_new && known > 0;
    Tile new_part = own[first];
    for (auto& values : new_part.values) std::fill_n(values, has_mixed_tile ? known : 0, 0.0);
    for (std::size_t j = 0; j <= i; ++j) {
      const Tile* const other = row(inverse_, j);
      const Eigen::Index begin = has_mixed_tile ? first + 1 : first;
      Matrix3 sum = product(own + begin, other + begin, end - begin);
      if (has_mixed_tile) sum += product(&new_part, other + first, 1);
      const auto r = 3 * static_cast<Eigen::Index>(i), c = 3 * static_cast<Eigen::Index>(j);
      if (!is_new) sum += stiffness_.block<3, 3>(r, c);
      stiffness_.block<3, 3>(r, c) = sum;
      stiffness_.block<3, 3>(c, r) = sum.transpose();
    }
  }
}

// Calls visit(tile, first row, count of rows) for the tiles of V of a block.
template <typename Visit>
void Compliance::for_each_tile(const Columns& columns, Visit&& visit) const {
  const Tile* tile = tiles_.data() + columns.tiles;
  for (std::size_t i = columns.first_range; i < columns.last_range; ++i) {
    for (Eigen::Index t = ranges_[i].first; t < ranges_[i].second; ++t, ++tile)
      visit(Eigen::Map<const TileMatrix>(tile->values[0]), kTile * t, std::min<Eigen::Index>(kTile, rows_ - kTile * t));
  }
}

Vector3 Compliance::displacement(std::size_t place, const VectorX& half) const {
  Vector3 sum = Vector3::Zero();
  for_each_tile(columns_[place], [&](const auto& tile, Eigen::Index first, Eigen::Index count) {
    if (count == kTile) {
      sum.noalias() += tile.transpose() * half.segment<kTile>(first);
    } else {
      sum.noalias() += tile.topRows(count).transpose() * half.segment(first, count);
    }
  });
  return sum;
}

void Compliance::add_forces(const Eigen::Ref<const VectorX>& forces, VectorX& half) const {
  for (std::size_t place = 0; place < blocks_.size(); ++place) {
    const Vector3 force = forces.segment<3>(3 * static_cast<Eigen::Index>(place));
    if (force.isZero(0)) continue;
    for_each_tile(columns_[place], [&](const auto& tile, Eigen::Index first, Eigen::Index count) {
      if (count == kTile) {
        half.segment<kTile>(first).noalias() += tile * force;
      } else {
        half.segment(first, count).noalias() += tile.topRows(count) * force;
      }
    });
  }
}

}  // namespace softhand
