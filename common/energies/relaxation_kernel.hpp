// The step of the Prony branches of tetrahedra (relaxing_tissue.hpp), in parallel lanes. One source
// (relaxation_kernel_source.hpp) is compiled for each instruction set. All sets give the same bits (tissue_kernel.hpp).
#pragma once

#include <cstddef>

#include "energies/tissue_kernel.hpp"

namespace softhand {

inline constexpr std::size_t kRelaxationBranches = 3;
/// Sixteen values for each entry of a symmetric tensor: xx, yy, zz, yz, zx, xy.
using TensorBatch = double[6][kElementBatch];

/// The branches of a batch of tissue.
struct alignas(64) RelaxationBatch {
  double weight[kRelaxationBranches][kElementBatch];  ///< c
  // Within a step: U = V gamma W(F) + V A : E + C.
  double volume[kElementBatch];    ///< V gamma, m^3
  TensorBatch stress;              ///< V A, J
  double constant[kElementBatch];  ///< C, J
  TensorBatch elastic_stress;      ///< S_e at the start of the step, Pa

  /// Copies the step of an element.
  void copy_step(std::size_t lane, const RelaxationBatch& from, std::size_t from_lane) {
    volume[lane] = from.volume[from_lane];
    for (std::size_t k = 0; k < 6; ++k) stress[k][lane] = from.stress[k][from_lane];
    constant[lane] = from.constant[from_lane];
  }
};

/// Numbers of d for sixteen elements: by branch, entry and lane.
inline constexpr std::size_t kMemoryBatch = kRelaxationBranches * 6 * kElementBatch;

/// Of a branch in a step.
struct RelaxationDecay {
  double kept = 1;   ///< e^-a
  double late = 0;   ///< 1 - g
  double early = 0;  ///< g - e^-a
};

/// `positions`: three per node, metres. `memory`: `kMemoryBatch` numbers per batch.
struct RelaxationKernel {
  /// Sets the function of a step that begins at `positions`.
  void (*begin)(const TissueBatch* tissue, RelaxationBatch* batches, std::size_t count, const double* memory,
                const double* positions, const RelaxationDecay (&decay)[kRelaxationBranches]);
  /// Moves the memory to the step's end. Sets the function of a next step that begins there and lasts as long. Returns
  /// what the lasting stress stores, J.
  double (*end)(const TissueBatch* tissue, RelaxationBatch* batches, std::size_t count, double* memory,
                const double* positions, const RelaxationDecay (&decay)[kRelaxationBranches]);
};

/// The kernel for `set`. If this build has none (other architecture), the baseline's kernel.
RelaxationKernel relaxation_kernel(InstructionSet set);

}  // namespace softhand
