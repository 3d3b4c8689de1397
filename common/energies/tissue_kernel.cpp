// The baseline kernel, and the selection of a kernel.
#include "energies/tissue_kernel.hpp"

#include "energies/tissue_kernel_source.hpp"

namespace softhand {

// Defined in the files of these names. CMake compiles each with the flags of its instruction set.
double tissue_energy_avx2(const TissueBatch* batches, const RelaxationBatch* relaxation, std::size_t count,
                          const double* positions, const ElementOutput& output);
double tissue_energy_avx512(const TissueBatch* batches, const RelaxationBatch* relaxation, std::size_t count,
                            const double* positions, const ElementOutput& output);

TissueKernel tissue_kernel(InstructionSet set) {
#if defined(__x86_64__)
  if (set == InstructionSet::avx2) return tissue_energy_avx2;
  if (set == InstructionSet::avx512) return tissue_energy_avx512;
#endif
  static_cast<void>(set);
  return tissue_energy;
}

}  // namespace softhand
