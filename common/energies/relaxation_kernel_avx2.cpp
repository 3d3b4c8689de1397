// Compiled for AVX2; empty on other architectures.
#if defined(__AVX2__)
#include "energies/relaxation_kernel_source.hpp"

namespace softhand {

RelaxationKernel relaxation_kernel_avx2();
RelaxationKernel relaxation_kernel_avx2() { return {relaxation_begin, relaxation_end}; }

}  // namespace softhand
#endif
