#include "energies/element_batch.hpp"

#include "math/block_matrix.hpp"

namespace softhand {

void ElementBatch::set(std::size_t lane, const std::array<std::int32_t, 4>& nodes,
                       const std::array<double, 9>& inverse) {
  for (std::size_t a = 0; a < 4; ++a) node[a][lane] = nodes[a];
  for (std::size_t k = 0; k < 9; ++k) shape[k][lane] = inverse[k];
  for (auto& blocks : slot) blocks[lane] = -1;
}

void ElementBatch::add_pattern(BlockPattern& pattern) const {
  for (std::size_t lane = 0; lane < count; ++lane) {
    const std::array<int, 4> blocks{node[0][lane], node[1][lane], node[2][lane], node[3][lane]};
    pattern.add_clique(blocks);
  }
}

void ElementBatch::bind(const BlockMatrix& matrix) {
  for (std::size_t lane = 0; lane < kElementBatch; ++lane) {
    std::size_t block = 0;
    for (std::size_t a = 0; a < 4; ++a) {
      for (std::size_t b = 0; b <= a; ++b) slot[block++][lane] = matrix.find(node[a][lane], node[b][lane]).index;
    }
  }
}

}  // namespace softhand
