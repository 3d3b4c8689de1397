// Energy, forces and stiffness of tetrahedra, evaluated in parallel in the lanes of the machine's vectors. One source
// (tissue_kernel_source.hpp) is compiled for each instruction set. The material law is defined in corotational.hpp.
//
// All instruction sets give the same bits: lanes never mix, nothing is fused or approximated, and elements are summed
// in their order. The relative difference from the scalar functions of corotational.hpp is below 1e-12. For energy and
// Hessian it is relative to their own value. For forces it is relative to the forces at a strain of one, because F - R
// cancels near rest. Exception: if s_2 + s_3 vanishes relative to s_1, the polar rotation is not unique and the forces
// may differ.
#pragma once

#include <cstddef>
#include <cstdint>

#include "energies/element_batch.hpp"
#include "math/instruction_set.hpp"

namespace softhand {

struct TissueBatch : ElementBatch {
  alignas(64) double volume[kElementBatch];                            ///< m^3
  double mu[kElementBatch], lambda[kElementBatch];                     ///< Pa
  double limit_energy[kElementBatch], limit_stiffness[kElementBatch];  ///< W_max, k_s; J/m^3
  double limit_ramp[kElementBatch], ramp_rate[kElementBatch];          ///< w; 1/(2 w), or 0 without a ramp
};

/// `positions`: three per node, metres. Returns U_t in joules. If F is not finite in a lane, the result is NaN, and
/// only the forces on the nodes of this lane are not finite. Does not allocate.
using TissueKernel = double (*)(const TissueBatch* batches, std::size_t batch_count, const double* positions,
                                const ElementOutput& output);

/// The kernel for `set`. If this build has none (other architecture), the baseline's kernel.
TissueKernel tissue_kernel(InstructionSet set);

}  // namespace softhand
