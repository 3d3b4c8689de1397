// Symmetric sparse matrix in 3x3 blocks with a pattern that is fixed after construction.
//
// Degrees of freedom are numbered in blocks of three. A tissue node is one block, a rigid body two (translation, then
// rotation), so that a body's 6x6 block is four neighbouring 3x3 blocks. Only the lower triangle (row >= column) is
// stored, compressed by block column, rows ascending. Terms look their slots up once (`find`) and then add without
// searching.
#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "math/types.hpp"

namespace softhand {

/// The set of block positions that the terms of a scene may ever touch. Diagonal blocks are always present.
class BlockPattern {
 public:
  explicit BlockPattern(int block_count) : block_count_(block_count) {}
  int block_count() const { return block_count_; }
  /// Declares the block (row, column) and its mirror image. Order and repetition do not matter.
  void add(int row, int column);
  /// Declares every pair among `blocks`.
  void add_clique(std::span<const int> blocks);
  /// Sorted, unique (column, row) pairs of the lower triangle, diagonal included.
  std::vector<std::pair<int, int>> lower_triangle() const;

 private:
  int block_count_;
  std::vector<std::pair<int, int>> pairs_;  // (column, row), row >= column
};

/// Where a term adds a block: `index` into the stored blocks; `transposed` where the asked position lies in the upper
/// triangle.
struct BlockSlot {
  std::int32_t index = -1;
  bool transposed = false;
};

class BlockMatrix {
 public:
  BlockMatrix() = default;
  explicit BlockMatrix(const BlockPattern& pattern);

  int block_count() const { return static_cast<int>(column_start_.size()) - 1; }
  int stored_blocks() const { return static_cast<int>(row_.size()); }
  /// Compressed block columns of the lower triangle.
  std::span<const std::int32_t> column_start() const { return column_start_; }
  std::span<const std::int32_t> row() const { return row_; }
  /// Nine doubles a block, column-major, in the order of `row()`.
  std::span<const double> values() const { return values_; }
  std::span<double> values() { return values_; }

  /// The slot of block (row, column); std::out_of_range where the pattern has no such block.
  BlockSlot find(int row, int column) const;
  void set_zero();
  /// Adds `block` as the (row, column) block that `slot` was looked up for. A symmetric matrix holds each off-diagonal
  /// pair once: add the pair's block for one order only.
  void add(BlockSlot slot, const Matrix3& block) {
    if (journals_) note(slot.index);
    Eigen::Map<Matrix3> stored(values_.data() + 9 * static_cast<std::ptrdiff_t>(slot.index));
    if (slot.transposed) {
      stored += block.transpose();
    } else {
      stored += block;
    }
  }
  /// From here on `add` remembers what the blocks were that it adds to, until `take_back` or `set_zero`.
  void begin_journal();
  /// The stored blocks that were added to since.
  std::span<const std::int32_t> journal() const { return journal_; }
  /// Makes these blocks what they were, to the bit, and goes on remembering.
  void take_back();
  /// Frobenius norm of the difference between what was added since the last `take_back` and what that one removed, over
  /// the larger norm of the two.
  double change_since_taken_back() const;
  /// y = A x, both halves counted. Sizes 3 * block_count().
  void multiply(const VectorX& x, VectorX& y) const;
  /// The full matrix, for tests.
  Eigen::MatrixXd dense() const;

 private:
  std::vector<std::int32_t> column_start_{0};
  std::vector<std::int32_t> row_;
  std::vector<double> values_;

  void note(std::int32_t block);
  bool journals_ = false;
  std::vector<std::int32_t> journal_;
  std::vector<double> before_;          // nine a block of the journal
  std::vector<std::uint8_t> is_noted_;  // by stored block
  std::vector<std::int32_t> removed_;   // by stored block: its place in `removed_parts_`, -1: nothing was removed
  std::vector<std::int32_t> removed_blocks_;
  std::vector<double> removed_parts_;  // nine a block
};

}  // namespace softhand
