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

#include "math/instruction_set.hpp"

namespace softhand {

inline constexpr std::size_t kTissueBatch = 16;

/// Sixteen elements as a structure of arrays. The lanes from `count` on repeat the last element. They are not added to
/// the result.
struct alignas(64) TissueBatch {
  double shape[9][kTissueBatch];  ///< D_m^-1, row-major: its rows are b_1, b_2, b_3; b_0 = -(b_1 + b_2 + b_3)
  double volume[kTissueBatch];    ///< m^3
  double mu[kTissueBatch], lambda[kTissueBatch];                     ///< Pa
  double limit_energy[kTissueBatch], limit_stiffness[kTissueBatch];  ///< W_max, k_s; J/m^3
  std::int32_t node[4][kTissueBatch];                                ///< ascending within an element
  std::int32_t slot[10][kTissueBatch];  ///< stored block of (a, b), a >= b, row by row; -1 until bound
  std::size_t count = 0;
};

/// Selects the outputs besides the energy. Null pointers: not computed.
struct TissueOutput {
  double* gradient = nullptr;  ///< three per node; dU/dx is added
  double* blocks = nullptr;    ///< nine per stored block, column-major; the Hessian is added
  bool projected = true;       ///< the Hessian is positive semi-definite (true) or exact (false)
  /// If gradient and Hessian are requested: computes the Hessian's axes and products in float, accurate to 1e-6 of an
  /// element's largest entry.
  bool single_blocks = false;
};

/// `positions`: three per node, metres. Returns U_t in joules. If F is not finite in a lane, the result is NaN, and
/// only the forces on the nodes of this lane are not finite. Does not allocate.
using TissueKernel = double (*)(const TissueBatch* batches, std::size_t batch_count, const double* positions,
                                const TissueOutput& output);

/// The kernel for `set`. If this build has none (other architecture), the baseline's kernel.
TissueKernel tissue_kernel(InstructionSet set);

}  // namespace softhand
