#include "math/block_matrix.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <stdexcept>
#include <string>

namespace softhand {
namespace {

constexpr std::size_t kBorderInUse = 8;  // blocks of the border in use, per block row; more would allocate

}  // namespace

void BlockPattern::add(int row, int column) {
  if (row < 0 || column < 0 || row >= block_count_ || column >= block_count_) {
    throw std::out_of_range("BlockPattern: block (" + std::to_string(row) + ", " + std::to_string(column) +
                            ") outside " + std::to_string(block_count_));
  }
  pairs_.emplace_back(std::min(row, column), std::max(row, column));
}

void BlockPattern::add_clique(std::span<const int> blocks) {
  for (std::size_t a = 0; a < blocks.size(); ++a) {
    for (std::size_t b = 0; b <= a; ++b) add(blocks[a], blocks[b]);
  }
}

std::vector<std::pair<int, int>> BlockPattern::lower_triangle() const {
  const int core = block_count_ - border_count_;
  std::vector<std::pair<int, int>> all;
  for (const auto& pair : pairs_) {
    if (pair.second < core) all.push_back(pair);
  }
  for (int block = 0; block < core; ++block) all.emplace_back(block, block);
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

BlockMatrix::BlockMatrix(const BlockPattern& pattern) {
  const auto pairs = pattern.lower_triangle();
  border_count_ = pattern.border_count();
  column_start_.assign(static_cast<std::size_t>(pattern.block_count() - border_count_) + 1, 0);
  row_.reserve(pairs.size());
  column_.reserve(pairs.size());
  for (const auto& [column, row] : pairs) {
    ++column_start_[static_cast<std::size_t>(column) + 1];
    row_.push_back(row);
    column_.push_back(column);
  }
  for (std::size_t c = 1; c < column_start_.size(); ++c) column_start_[c] += column_start_[c - 1];
  // Row by row of the border: all blocks of the core, then those of the border up to the diagonal.
  const auto core = static_cast<std::size_t>(core_count()), border = static_cast<std::size_t>(border_count_);
  const std::size_t border_blocks = border * core + border * (border + 1) / 2;
  first_loose_ = static_cast<std::int32_t>(row_.size() + border_blocks);
  const auto loose = static_cast<std::size_t>(pattern.loose_count());
  loose_in_use_.reserve(loose);
  loose_.reserve(loose);
  if (loose > 0) loose_table_.assign(std::bit_ceil(2 * loose), -1);
  const std::size_t stored = row_.size() + border_blocks + loose;
  values_.assign(9 * stored, 0.0);
  // Far less than the whole border is in use at a time.
  const std::size_t used = row_.size() + std::min(border_blocks, kBorderInUse * (core + border)) + loose;
  in_use_.reserve(used);
  is_in_use_.assign(border_blocks, 0);
  journal_.reserve(used);
  before_.reserve(9 * used);
  is_noted_.assign(stored, 0);
  removed_.assign(stored, -1);
  removed_blocks_.reserve(used);
  removed_parts_.reserve(9 * used);
}

BlockSlot BlockMatrix::find(int row, int column) const {
  const bool transposed = row < column;
  const int c = std::min(row, column);
  const int r = std::max(row, column);
  const int core = core_count();
  if (c >= 0 && r >= core && r < block_count()) {
    const int border_row = r - core;
    return {core_blocks() + border_row * core + border_row * (border_row + 1) / 2 + c, transposed};
  }
  if (c >= 0 && r < core) {
    const std::int32_t stored = find_core(r, c);
    if (stored >= 0) return {stored, transposed};
  }
  throw std::out_of_range("BlockMatrix: no block (" + std::to_string(row) + ", " + std::to_string(column) +
                          ") in the pattern");
}

// The stored block of the core, row >= column. -1: the pattern has no such block.
std::int32_t BlockMatrix::find_core(int row, int column) const {
  const auto begin = row_.begin() + column_start_[static_cast<std::size_t>(column)];
  const auto end = row_.begin() + column_start_[static_cast<std::size_t>(column) + 1];
  const auto found = std::lower_bound(begin, end, row);
  return found != end && *found == row ? static_cast<std::int32_t>(found - row_.begin()) : -1;
}

// The entry of the hash table that holds this loose block, or the empty entry where it belongs.
std::size_t BlockMatrix::loose_place(std::int32_t row, std::int32_t column) const {
  const std::size_t mask = loose_table_.size() - 1;
  std::size_t place = (static_cast<std::size_t>(row) * 2654435761u + static_cast<std::size_t>(column) * 40503u) & mask;
  while (loose_table_[place] >= 0 && loose_[static_cast<std::size_t>(loose_table_[place])] != std::pair(row, column))
    place = (place + 1) & mask;
  return place;
}

BlockSlot BlockMatrix::pair(int row, int column) {
  const bool transposed = row < column;
  const std::int32_t c = std::min(row, column), r = std::max(row, column);
  const std::int32_t stored = find_core(r, c);
  if (stored >= 0) return {stored, transposed};
  if (loose_table_.empty()) return {};
  std::int32_t& entry = loose_table_[loose_place(r, c)];
  if (entry < 0) {
    if (first_loose_ + static_cast<std::int32_t>(loose_.size()) == stored_blocks()) return {};
    entry = static_cast<std::int32_t>(loose_.size());
    loose_.emplace_back(r, c);
    loose_in_use_.push_back(first_loose_ + entry);
  }
  return {first_loose_ + entry, transposed};
}

void BlockMatrix::clear_loose() {
  // In reverse, so that the search for an entry never meets an entry that is already empty.
  for (std::size_t k = loose_.size(); k-- > 0;) {
    loose_table_[loose_place(loose_[k].first, loose_[k].second)] = -1;
    std::fill_n(values_.begin() + 9 * (first_loose_ + static_cast<std::ptrdiff_t>(k)), 9, 0.0);
  }
  loose_.clear();
  loose_in_use_.clear();
}

std::pair<std::int32_t, std::int32_t> BlockMatrix::position_outside_core(std::int32_t stored) const {
  if (stored >= first_loose_) return loose_[static_cast<std::size_t>(stored - first_loose_)];
  std::int32_t column = stored - core_blocks(), row = core_count();
  while (column > row) column -= ++row;
  return {row, column};
}

void BlockMatrix::set_zero() {
  std::fill_n(values_.begin(), 9 * core_blocks(), 0.0);
  for (const std::int32_t block : in_use_) {
    std::fill_n(values_.begin() + 9 * static_cast<std::ptrdiff_t>(block), 9, 0.0);
    is_in_use_[static_cast<std::size_t>(block - core_blocks())] = 0;
  }
  in_use_.clear();
  clear_loose();
  begin_journal();
  journals_ = false;
}

void BlockMatrix::begin_journal() {
  for (const std::int32_t block : journal_) is_noted_[static_cast<std::size_t>(block)] = 0;
  journal_.clear();
  before_.clear();
  journals_ = true;
}

void BlockMatrix::note(std::int32_t block) {
  std::uint8_t& noted = is_noted_[static_cast<std::size_t>(block)];
  if (noted != 0) return;
  noted = 1;
  journal_.push_back(block);
  const auto value = values_.begin() + 9 * static_cast<std::ptrdiff_t>(block);
  before_.insert(before_.end(), value, value + 9);
}

void BlockMatrix::take_back() {
  for (const std::int32_t block : removed_blocks_) removed_[static_cast<std::size_t>(block)] = -1;
  removed_blocks_.clear();
  removed_parts_.clear();
  for (std::size_t k = 0; k < journal_.size(); ++k) {
    const std::int32_t block = journal_[k];
    removed_[static_cast<std::size_t>(block)] = static_cast<std::int32_t>(k);
    removed_blocks_.push_back(block);
    double* const value = values_.data() + 9 * static_cast<std::ptrdiff_t>(block);
    for (std::size_t i = 0; i < 9; ++i) {
      removed_parts_.push_back(value[i] - before_[9 * k + i]);
      value[i] = before_[9 * k + i];
    }
  }
  clear_loose();
  begin_journal();
}

double BlockMatrix::change_since_taken_back() const {
  double removed = 0, added = 0, replaced = 0, change = 0;  // squared norms
  for (std::size_t k = 0; k < removed_blocks_.size(); ++k) {
    if (removed_blocks_[k] >= core_blocks()) continue;
    for (std::size_t i = 0; i < 9; ++i) removed += removed_parts_[9 * k + i] * removed_parts_[9 * k + i];
  }
  for (std::size_t k = 0; k < journal_.size(); ++k) {
    if (journal_[k] >= core_blocks()) continue;
    const double* const value = values_.data() + 9 * static_cast<std::ptrdiff_t>(journal_[k]);
    const std::int32_t place = removed_[static_cast<std::size_t>(journal_[k])];
    for (std::size_t i = 0; i < 9; ++i) {
      const double now = value[i] - before_[9 * k + i];
      const double then = place < 0 ? 0.0 : removed_parts_[9 * static_cast<std::size_t>(place) + i];
      added += now * now;
      replaced += then * then;
      change += (now - then) * (now - then);
    }
  }
  change += std::max(0.0, removed - replaced);  // blocks to which nothing was added since
  const double largest = std::max(removed, added);
  return largest > 0 ? std::sqrt(change / largest) : 0.0;
}

// Calls visit(row, column, block) for each stored block that may differ from zero.
template <typename Visit>
void BlockMatrix::for_each(Visit&& visit) const {
  const auto block = [this](std::int32_t k) {
    return Eigen::Map<const Matrix3>(values_.data() + 9 * static_cast<std::ptrdiff_t>(k));
  };
  for (int column = 0; column < core_count(); ++column) {
    for (std::int32_t k = column_start_[static_cast<std::size_t>(column)];
         k < column_start_[static_cast<std::size_t>(column) + 1]; ++k) {
      visit(row_[static_cast<std::size_t>(k)], column, block(k));
    }
  }
  for (const std::span<const std::int32_t> others : {border_in_use(), loose_in_use()}) {
    for (const std::int32_t k : others) {
      const auto [row, column] = position(k);
      visit(row, column, block(k));
    }
  }
}

void BlockMatrix::multiply(const VectorX& x, VectorX& y) const {
  y.setZero(3 * block_count());
  for_each([&](int row, int column, const auto& block) {
    y.segment<3>(3 * row) += block * x.segment<3>(3 * column);
    if (row != column) y.segment<3>(3 * column) += block.transpose() * x.segment<3>(3 * row);
  });
}

Eigen::MatrixXd BlockMatrix::dense() const {
  Eigen::MatrixXd full = Eigen::MatrixXd::Zero(3 * block_count(), 3 * block_count());
  for_each([&](int row, int column, const auto& block) {
    full.block<3, 3>(3 * row, 3 * column) = block;
    if (row != column) full.block<3, 3>(3 * column, 3 * row) = block.transpose();
  });
  return full;
}

}  // namespace softhand
