// Compiled for AVX-512; empty on other architectures.
#if defined(__AVX512F__)
#include "energies/relaxation_kernel_source.hpp"

namespace softhand {

RelaxationKernel relaxation_kernel_avx512();
RelaxationKernel relaxation_kernel_avx512() { return {relaxation_begin, relaxation_end}; }

}  // namespace softhand
#endif
