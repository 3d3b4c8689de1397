// A bar of 6,000 tetrahedra for the tissue's kernels. It is strained by some per cent, so that some tetrahedra pass the
// strain limit.
#pragma once

#include "energies/energy.hpp"
#include "support/box_mesh.hpp"

namespace softhand::bench {

struct TissueSample {
  HandModel box = testing::box_mesh({20, 5, 10}, Vector3(0.16, 0.02, 0.08), {"skin", 1000, 1e5, 0.45, 500, 500});
  State state = testing::rest_state(box);
  VectorX gradient = VectorX::Zero(3 * box.node_count());
  BlockMatrix matrix;

  TissueSample() {
    testing::Random random(1);
    for (int n = 0; n < box.node_count(); ++n) state.node_positions.col(n) += 3e-4 * random.vector();
  }
  /// Must be called before a term is evaluated into `matrix`.
  void bind(Energy& term) {
    BlockPattern pattern(box.node_count());
    term.add_pattern(pattern);
    matrix = BlockMatrix(pattern);
    term.bind(matrix);
  }
  double all(const Energy& term) { return term.add_all(state, gradient, matrix, Curvature::projected); }
};

}  // namespace softhand::bench
