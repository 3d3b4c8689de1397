// Tetrahedra in the lanes of the machine's vectors: their shape, nodes and blocks, sixteen at a time. Kernels include
// this file, so it includes no Eigen (math/lanes.hpp).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace softhand {

class BlockMatrix;
class BlockPattern;

inline constexpr std::size_t kElementBatch = 16;

/// Sixteen elements as a structure of arrays. The lanes from `count` on repeat the last element. They are not added to
/// the result.
struct alignas(64) ElementBatch {
  double shape[9][kElementBatch];        ///< D_m^-1, row-major: its rows are b_1, b_2, b_3; b_0 = -(b_1 + b_2 + b_3)
  std::int32_t node[4][kElementBatch];   ///< ascending within an element
  std::int32_t slot[10][kElementBatch];  ///< stored block of (a, b), a >= b, row by row; -1 until bound
  std::size_t count = 0;

  /// `nodes`: ascending. `inverse`: D_m^-1, 1/m, as `shape`. Does not change `count`.
  void set(std::size_t lane, const std::array<std::int32_t, 4>& nodes, const std::array<double, 9>& inverse);
  void add_pattern(BlockPattern& pattern) const;
  void bind(const BlockMatrix& matrix);
};

/// Selects the outputs besides the energy. Null pointers: not computed.
struct ElementOutput {
  double* gradient = nullptr;  ///< three per node; dU/dx is added
  double* blocks = nullptr;    ///< nine per stored block, column-major; the Hessian is added
  bool projected = true;       ///< the Hessian is positive semi-definite (true) or exact (false)
  /// If gradient and Hessian are requested: computes the Hessian's axes and products in float, accurate to 1e-6 of an
  /// element's largest entry.
  bool single_blocks = false;
};

}  // namespace softhand
