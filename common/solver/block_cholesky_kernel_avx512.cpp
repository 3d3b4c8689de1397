// Compiled for AVX-512 F, DQ and VL; empty on other architectures.
#if defined(__AVX512F__)
#include "solver/block_cholesky_kernel_source.hpp"

namespace softhand {

CholeskyKernel<double> cholesky_kernel_avx512(double);
CholeskyKernel<float> cholesky_kernel_avx512(float);
CholeskyKernel<double> cholesky_kernel_avx512(double) {
  return {factorize<double>, forward<double>, backward<double>, forward_columns<double>, add_products<double>};
}
CholeskyKernel<float> cholesky_kernel_avx512(float) {
  return {factorize<float>, forward<float>, backward<float>, forward_columns<float>, add_products<float>};
}

}  // namespace softhand
#endif
