// The baseline's kernels, and the choice of the kernel for an instruction set.
#include "solver/block_cholesky_kernel.hpp"

#include "solver/block_cholesky_kernel_source.hpp"

namespace softhand {

// Defined in the files of these names. CMake compiles them with the flags of their instruction set. The argument only
// selects the type.
CholeskyKernel<double> cholesky_kernel_avx2(double);
CholeskyKernel<float> cholesky_kernel_avx2(float);
CholeskyKernel<double> cholesky_kernel_avx512(double);
CholeskyKernel<float> cholesky_kernel_avx512(float);

template <typename Scalar>
CholeskyKernel<Scalar> cholesky_kernel(InstructionSet set) {
#if defined(__x86_64__)
  if (set == InstructionSet::avx2) return cholesky_kernel_avx2(Scalar{});
  if (set == InstructionSet::avx512) return cholesky_kernel_avx512(Scalar{});
#endif
  static_cast<void>(set);
  return {factorize<Scalar>,         forward<Scalar>,        backward<Scalar>,          forward_columns<Scalar>,
          subtract_products<Scalar>, add_transposed<Scalar>, add_columns<Scalar>,       extend_factor<Scalar>,
          extend_inverse<Scalar>,    extend_gram<Scalar>,    subtract_symmetric<Scalar>};
}

template CholeskyKernel<double> cholesky_kernel(InstructionSet set);
template CholeskyKernel<float> cholesky_kernel(InstructionSet set);

}  // namespace softhand
