// Energy, forces and stiffness of the Prony branches of tetrahedra, in parallel lanes. One source
// (relaxation_kernel_source.hpp) is compiled for each instruction set. All sets give the same bits (tissue_kernel.hpp).
#pragma once

#include <cstddef>

#include "energies/element_batch.hpp"
#include "math/instruction_set.hpp"

namespace softhand {

inline constexpr std::size_t kRelaxationBranches = 3;
/// Sixteen values for each component of a symmetric tensor: xx, yy, zz, yz, zx, xy.
using StrainBatch = double[6][kElementBatch];

struct RelaxationBatch : ElementBatch {
  alignas(64) double stiffness[kRelaxationBranches][kElementBatch];  ///< V mu w, J; 0 in lanes without an element
  // Within a step: U = K E:E + 2 M:E + C.
  double quadratic[kElementBatch];  ///< K, J
  StrainBatch linear;               ///< M, J
  double constant[kElementBatch];   ///< C, J
  StrainBatch start;                ///< E_0
};

/// Numbers of h for sixteen elements: by branch, component and lane.
inline constexpr std::size_t kSpringBatch = kRelaxationBranches * 6 * kElementBatch;

/// Of a branch in a step.
struct RelaxationDecay {
  double kept = 1;   ///< e^-a
  double taken = 1;  ///< g
  /// The heat of the damper is V mu w times the sum of these products with |h|^2, h:(E - E_0) and |E - E_0|^2.
  double heat[3] = {0, 0, 0};
};

/// `positions`: three per node, metres. `springs`: `kSpringBatch` numbers per batch.
struct RelaxationKernel {
  /// Sets the function of a step that begins at `positions`.
  void (*begin)(RelaxationBatch* batches, std::size_t count, const double* springs, const double* positions,
                const RelaxationDecay (&decay)[kRelaxationBranches]);
  /// Returns the energy, J.
  double (*energy)(const RelaxationBatch* batches, std::size_t count, const double* positions,
                   const ElementOutput& output);
  /// Moves the springs to the step's end. Sets the function of a next step that begins there and lasts as long. Adds
  /// what the springs store then, and the heat of the dampers, J.
  void (*end)(RelaxationBatch* batches, std::size_t count, double* springs, const double* positions,
              const RelaxationDecay (&decay)[kRelaxationBranches], double& stored, double& heat);
};

/// The kernel for `set`. If this build has none (other architecture), the baseline's kernel.
RelaxationKernel relaxation_kernel(InstructionSet set);

}  // namespace softhand
