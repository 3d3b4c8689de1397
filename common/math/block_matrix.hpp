// Symmetric sparse matrix of 3x3 blocks. The pattern is fixed after construction.
//
// Degrees of freedom are numbered in blocks of three. A tissue node has one block. A rigid body has two (translation,
// then rotation), so a body's 6x6 block consists of four neighbouring 3x3 blocks. Only the lower triangle (row >=
// column) is stored, compressed by block column with ascending rows. Terms look up their slots once (`find`) and then
// add without a search.
//
// The last blocks may form a border: the rigid objects. The border has memory for every block (row of the border,
// column), and keeps a list of those in use. So any term may couple an object to anything, and an object that nothing
// is coupled to costs nothing. The other blocks are the core.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "math/types.hpp"

namespace softhand {

/// The set of block positions that the terms of a scene can ever add to. It always contains the diagonal blocks.
class BlockPattern {
 public:
  /// The last `border_count` of all blocks form the border.
  explicit BlockPattern(int block_count, int border_count = 0)
      : block_count_(block_count), border_count_(border_count) {}
  int block_count() const { return block_count_; }
  int border_count() const { return border_count_; }
  /// Adds the block (row, column) and its mirror image. Order and repetition do not matter. Blocks of the border need
  /// not be added.
  void add(int row, int column);
  /// Adds every pair of `blocks`.
  void add_clique(std::span<const int> blocks);
  /// Makes room for `count` more loose blocks (`BlockMatrix::pair`).
  void add_loose(int count) { loose_count_ += count; }
  int loose_count() const { return loose_count_; }
  /// Sorted, unique (column, row) pairs of the core's lower triangle, diagonal included.
  std::vector<std::pair<int, int>> lower_triangle() const;

 private:
  int block_count_, border_count_;
  int loose_count_ = 0;
  std::vector<std::pair<int, int>> pairs_;  // (column, row), row >= column
};

/// The place where a term adds a block. `index` counts the stored blocks. `transposed` is true if the requested
/// position lies in the upper triangle.
struct BlockSlot {
  std::int32_t index = -1;
  bool transposed = false;
};

class BlockMatrix {
 public:
  BlockMatrix() = default;
  explicit BlockMatrix(const BlockPattern& pattern);

  int block_count() const { return core_count() + border_count_; }
  int core_count() const { return static_cast<int>(column_start_.size()) - 1; }
  int border_count() const { return border_count_; }
  /// Blocks with memory, of the core and in total. The blocks of the core come first, the loose blocks last.
  int core_blocks() const { return static_cast<int>(row_.size()); }
  int stored_blocks() const { return static_cast<int>(values_.size() / 9); }
  /// Row indices and start of each block column of the core, lower triangle.
  std::span<const std::int32_t> column_start() const { return column_start_; }
  std::span<const std::int32_t> row() const { return row_; }
  /// Row and column of a stored block, row >= column.
  std::pair<std::int32_t, std::int32_t> position(std::int32_t stored) const {
    const auto block = static_cast<std::size_t>(stored);
    return is_core(stored) ? std::pair(row_[block], column_[block]) : position_outside_core(stored);
  }
  /// The stored blocks of the border that `add` changed since `set_zero`, in the order of their first use.
  std::span<const std::int32_t> border_in_use() const { return in_use_; }
  /// The stored loose blocks, in the order of their first use since `set_zero` or `take_back`.
  std::span<const std::int32_t> loose_in_use() const { return loose_in_use_; }
  /// Whether this is a block of the core's pattern, of which a factor can be made.
  bool is_core(std::int32_t stored) const { return stored < core_blocks(); }
  /// Nine doubles per block, column-major: those of the core in the order of `row()`, then the border, then the loose.
  std::span<const double> values() const { return values_; }
  std::span<double> values() { return values_; }

  /// The slot of block (row, column). Throws std::out_of_range if the pattern has no such block.
  BlockSlot find(int row, int column) const;
  /// The slot of a block between two blocks of the core that the pattern need not have. A block outside the pattern is
  /// loose: it is valid until `set_zero` or `take_back`, and no factor contains it. If there is no room for another
  /// loose block, the result is invalid: its index is -1. Does not allocate.
  BlockSlot pair(int row, int column);
  void set_zero();
  /// Adds `block` at the position (row, column) that `slot` was looked up for. A symmetric matrix stores each
  /// off-diagonal pair once, so add the block of a pair for one order only.
  void add(BlockSlot slot, const Matrix3& block) {
    if (slot.index >= core_blocks() && slot.index < first_loose_) use(slot.index);
    if (journals_) note(slot.index);
    Eigen::Map<Matrix3> stored(values_.data() + 9 * static_cast<std::ptrdiff_t>(slot.index));
    if (slot.transposed) {
      stored += block.transpose();
    } else {
      stored += block;
    }
  }
  /// From now on `add` records the previous values of the blocks that it changes, until `take_back` or `set_zero`.
  void begin_journal();
  /// Indices of the stored blocks that `add` changed since then.
  std::span<const std::int32_t> journal() const { return journal_; }
  /// The k-th block of the journal without what was added.
  Eigen::Map<const Matrix3> previous(std::size_t k) const {
    return Eigen::Map<const Matrix3>(before_.data() + 9 * static_cast<std::ptrdiff_t>(k));
  }
  /// What was added to the k-th block of the journal.
  Matrix3 added(std::size_t k) const {
    return Eigen::Map<const Matrix3>(values_.data() + 9 * static_cast<std::ptrdiff_t>(journal_[k])) - previous(k);
  }
  /// Restores the previous values of these blocks, equal to the bit, and starts a new journal. Loose blocks end: they
  /// must have been added since `begin_journal`.
  void take_back();
  /// Relative change of the added part in the core. Let A be the sum of the blocks added since the last `take_back`,
  /// and R the part that this `take_back` removed. Returns |A - R| / max(|A|, |R|) with Frobenius norms. The border is
  /// left out: an object's block sums all its contacts and would hide the change of one.
  double change_since_taken_back() const;
  /// y = A x with both triangles. The vectors have 3 * block_count() entries.
  void multiply(const VectorX& x, VectorX& y) const;
  /// The full matrix. Used in tests.
  Eigen::MatrixXd dense() const;

 private:
  std::vector<std::int32_t> column_start_{0};
  std::vector<std::int32_t> row_, column_;  // per stored block of the core
  std::vector<double> values_;
  int border_count_ = 0;
  std::vector<std::int32_t> in_use_;
  std::vector<std::uint8_t> is_in_use_;  // per stored block of the border
  std::int32_t first_loose_ = 0;
  std::vector<std::int32_t> loose_in_use_;
  std::vector<std::pair<std::int32_t, std::int32_t>> loose_;  // per loose block in use: row and column
  std::vector<std::int32_t> loose_table_;  // hash table of the loose blocks in use, open addressing; -1: empty

  std::int32_t find_core(int row, int column) const;
  std::pair<std::int32_t, std::int32_t> position_outside_core(std::int32_t stored) const;
  std::size_t loose_place(std::int32_t row, std::int32_t column) const;
  void clear_loose();
  void use(std::int32_t block) {
    std::uint8_t& used = is_in_use_[static_cast<std::size_t>(block - core_blocks())];
    if (used != 0) return;
    used = 1;
    in_use_.push_back(block);
  }
  template <typename Visit>
  void for_each(Visit&& visit) const;
  void note(std::int32_t block);
  bool journals_ = false;
  std::vector<std::int32_t> journal_;
  std::vector<double> before_;          // nine per block of the journal
  std::vector<std::uint8_t> is_noted_;  // per stored block
  std::vector<std::int32_t> removed_;   // per stored block: its position in `removed_parts_`; -1: nothing was removed
  std::vector<std::int32_t> removed_blocks_;
  std::vector<double> removed_parts_;  // nine per block
};

}  // namespace softhand
