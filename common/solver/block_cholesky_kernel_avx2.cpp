// Compiled for AVX2 and FMA; empty on other architectures.
#if defined(__AVX2__)
#include "solver/block_cholesky_kernel_source.hpp"

namespace softhand {

CholeskyKernel<double> cholesky_kernel_avx2(double);
CholeskyKernel<float> cholesky_kernel_avx2(float);
CholeskyKernel<double> cholesky_kernel_avx2(double) {
  return {factorize<double>, forward<double>, backward<double>, forward_columns<double>, add_products<double>};
}
CholeskyKernel<float> cholesky_kernel_avx2(float) {
  return {factorize<float>, forward<float>, backward<float>, forward_columns<float>, add_products<float>};
}

}  // namespace softhand
#endif
