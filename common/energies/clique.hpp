// The blocks that one small element couples. Scatters the element's dense gradient and Hessian into the global gradient
// and Hessian.
#pragma once

#include <array>
#include <cstddef>

#include "math/block_matrix.hpp"

namespace softhand {

/// `size` blocks of three degrees of freedom, all coupled to each other.
template <int size>
class Clique {
 public:
  using Gradient = Eigen::Matrix<double, 3 * size, 1>;
  using Hessian = Eigen::Matrix<double, 3 * size, 3 * size>;

  Clique() = default;
  explicit Clique(const std::array<int, size>& blocks) : blocks_(blocks) {}

  void add_pattern(BlockPattern& pattern) const { pattern.add_clique(blocks_); }
  void bind(const BlockMatrix& matrix) {
    std::size_t slot = 0;
    for (std::size_t row = 0; row < size; ++row) {
      for (std::size_t column = 0; column <= row; ++column) slots_[slot++] = matrix.find(blocks_[row], blocks_[column]);
    }
  }
  void add(VectorX& gradient, const Gradient& local) const {
    for (int row = 0; row < size; ++row) {
      gradient.segment<3>(3 * blocks_[static_cast<std::size_t>(row)]) += local.template segment<3>(3 * row);
    }
  }
  /// Reads the lower triangle of `local`'s blocks.
  void add(BlockMatrix& matrix, const Hessian& local) const {
    std::size_t slot = 0;
    for (int row = 0; row < size; ++row) {
      for (int column = 0; column <= row; ++column)
        matrix.add(slots_[slot++], local.template block<3, 3>(3 * row, 3 * column));
    }
  }

 private:
  std::array<int, size> blocks_{};
  std::array<BlockSlot, size*(size + 1) / 2> slots_{};
};

}  // namespace softhand
