// Compiled for AVX2; empty on other architectures.
#if defined(__AVX2__)
#include "energies/tissue_kernel_source.hpp"

namespace softhand {

double tissue_energy_avx2(const TissueBatch* batches, const RelaxationBatch* relaxation, std::size_t count,
                          const double* positions, const ElementOutput& output);
double tissue_energy_avx2(const TissueBatch* batches, const RelaxationBatch* relaxation, std::size_t count,
                          const double* positions, const ElementOutput& output) {
  return tissue_energy(batches, relaxation, count, positions, output);
}

}  // namespace softhand
#endif
