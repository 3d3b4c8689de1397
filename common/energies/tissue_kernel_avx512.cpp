// Compiled for AVX-512 F, DQ and VL; empty on other architectures.
#if defined(__AVX512F__)
#include "energies/tissue_kernel_source.hpp"

namespace softhand {

double tissue_energy_avx512(const TissueBatch* batches, const RelaxationBatch* relaxation, std::size_t count,
                            const double* positions, const ElementOutput& output);
double tissue_energy_avx512(const TissueBatch* batches, const RelaxationBatch* relaxation, std::size_t count,
                            const double* positions, const ElementOutput& output) {
  return tissue_energy(batches, relaxation, count, positions, output);
}

}  // namespace softhand
#endif
