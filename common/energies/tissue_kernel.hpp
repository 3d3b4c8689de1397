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

  /// Copies an element without its slots.
  void copy_lane(std::size_t lane, const TissueBatch& from, std::size_t from_lane) {
    for (std::size_t k = 0; k < 9; ++k) shape[k][lane] = from.shape[k][from_lane];
    for (std::size_t a = 0; a < 4; ++a) node[a][lane] = from.node[a][from_lane];
    volume[lane] = from.volume[from_lane];
    mu[lane] = from.mu[from_lane];
    lambda[lane] = from.lambda[from_lane];
    limit_energy[lane] = from.limit_energy[from_lane];
    limit_stiffness[lane] = from.limit_stiffness[from_lane];
    limit_ramp[lane] = from.limit_ramp[from_lane];
    ramp_rate[lane] = from.ramp_rate[from_lane];
  }
};

struct RelaxationBatch;  // relaxation_kernel.hpp

/// `relaxation`: one per batch, or null for the elastic law. `positions`: three per node, metres. Returns U_t in
/// joules. If F is not finite in a lane, the result is NaN, and only the forces on the nodes of this lane are not
/// finite. Does not allocate.
using TissueKernel = double (*)(const TissueBatch* batches, const RelaxationBatch* relaxation, std::size_t batch_count,
                                const double* positions, const ElementOutput& output);

/// The kernel for `set`. If this build has none (other architecture), the baseline's kernel.
TissueKernel tissue_kernel(InstructionSet set);

}  // namespace softhand
