// The baseline kernel, and the selection of a kernel.
#include "energies/relaxation_kernel.hpp"

#include "energies/relaxation_kernel_source.hpp"

namespace softhand {

// Defined in the files of these names. CMake compiles each with the flags of its instruction set.
RelaxationKernel relaxation_kernel_avx2();
RelaxationKernel relaxation_kernel_avx512();

RelaxationKernel relaxation_kernel(InstructionSet set) {
#if defined(__x86_64__)
  if (set == InstructionSet::avx2) return relaxation_kernel_avx2();
  if (set == InstructionSet::avx512) return relaxation_kernel_avx512();
#endif
  static_cast<void>(set);
  return {relaxation_begin, relaxation_end};
}

}  // namespace softhand
