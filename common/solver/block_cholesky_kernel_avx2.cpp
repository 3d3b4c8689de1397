// Compiled for AVX2 and FMA; empty on other architectures.
#if defined(__AVX2__)
#include "solver/block_cholesky_kernel_source.hpp"

namespace softhand {

CholeskyKernel<double> cholesky_kernel_avx2(double);
CholeskyKernel<float> cholesky_kernel_avx2(float);
CholeskyKernel<double> cholesky_kernel_avx2(double) {
  return {factorize<double>,         forward<double>,        backward<double>,          forward_columns<double>,
          subtract_products<double>, add_transposed<double>, add_columns<double>,       extend_factor<double>,
          extend_inverse<double>,    extend_gram<double>,    subtract_symmetric<double>};
}
CholeskyKernel<float> cholesky_kernel_avx2(float) {
  return {factorize<float>,         forward<float>,        backward<float>,          forward_columns<float>,
          subtract_products<float>, add_transposed<float>, add_columns<float>,       extend_factor<float>,
          extend_inverse<float>,    extend_gram<float>,    subtract_symmetric<float>};
}

}  // namespace softhand
#endif
