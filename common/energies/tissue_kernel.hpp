// Energy, forces and stiffness of tetrahedra side by side in the lanes of the machine's vectors: one source
// (tissue_kernel_source.hpp), compiled for each instruction set. The material law is that of corotational.hpp.
//
// Each instruction set gives the same bits: lanes never mix, nothing is fused or approximated, and elements are summed
// in their order. From the scalar functions of corotational.hpp they differ by less than 1e-12: energy and Hessian of
// themselves, forces of those at a strain of one (near rest F - R cancels). Only where s_2 + s_3 vanishes against s_1,
// and the polar rotation is any of many, may forces be others.
#pragma once

#include <cstddef>
#include <cstdint>

#include "math/instruction_set.hpp"

namespace softhand {

inline constexpr std::size_t kTissueBatch = 16;

/// Sixteen elements, a structure of arrays. The lanes from `count` on repeat the last element and are not added.
struct alignas(64) TissueBatch {
  double shape[9][kTissueBatch];  ///< D_m^-1, row-major: its rows are b_1, b_2, b_3; b_0 = -(b_1 + b_2 + b_3)
  double volume[kTissueBatch];    ///< m^3
  double mu[kTissueBatch], lambda[kTissueBatch];                     ///< Pa
  double limit_energy[kTissueBatch], limit_stiffness[kTissueBatch];  ///< W_max, k_s; J/m^3
  std::int32_t node[4][kTissueBatch];                                ///< ascending within an element
  std::int32_t slot[10][kTissueBatch];  ///< stored block of (a, b), a >= b, row by row; -1 until bound
  std::size_t count = 0;
};

/// What to compute besides the energy. Null pointers leave it out.
struct TissueOutput {
  double* gradient = nullptr;  ///< three a node; dU/dx is added
  double* blocks = nullptr;    ///< nine a stored block, column-major; the Hessian is added
  bool projected = true;       ///< the Hessian: positive semi-definite, or exact
  bool single_blocks = false;  ///< where gradient and Hessian are asked for: the Hessian's axes and products in float,
                               ///< to 1e-6 of an element's largest entry
};

/// `positions`: three a node, metres. Returns U_t in joules; not a number where a lane's F is not finite, and then only
/// that lane's nodes get forces that are not. Allocates nothing.
using TissueKernel = double (*)(const TissueBatch* batches, std::size_t batch_count, const double* positions,
                                const TissueOutput& output);

/// Where this build has none for `set` (another architecture), the baseline's.
TissueKernel tissue_kernel(InstructionSet set);

}  // namespace softhand
