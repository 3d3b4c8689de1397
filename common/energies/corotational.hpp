// Co-rotational elasticity with strain limiting: the material of the tissue (ES2725128A1 eqs. 22, 24, 27, 28, 30).
//
//   W_q(F) = mu |F - R|^2 + lambda/2 (tr(R^T F) - 3)^2,  R the polar rotation of F
//   W = W_q + k_s psi(x),  x = W_q/W_max - 1: gradient times m = 1 + k_s/W_max psi'(x),
//                                             Hessian gains k_s/W_max^2 psi''(x) g g^T with g = dW_q/dF
//
// The source has psi = x^2/2 for x > 0, and 0 below. So the stiffness jumps at W_max. A material may have a ramp
// 0 < w <= 1, along which the stiffness grows (ours):
//
//   psi = (x + w)^3/(12 w),  psi'' = (x + w)/(2 w)   for -w < x < w
//   psi = x^2/2 + w^2/6                              above: the stress is that of the source
//
// The Hessian is m (2 mu 1 + lambda r r^T + sum_k c_k q_k q_k^T) + k_s/W_max^2 psi'' g g^T with r = vec R and three
// twists q_k (Smith, De Goes and Kim 2019). It is a multiple of the identity plus a matrix of rank five. The
// coefficients are
//
//   c_k = 2 (lambda (tr S - 3) - 2 mu)/(s_i + s_j)
//
// The eigenvalue of a twist is 2 mu + c_k, so the projection is c_k >= -2 mu.
//
// Departures from the source: eq. 30 is read as P = U P(S) V^T. Only s_i + s_j -> 0 is singular. There the sum has a
// floor of 1e-9 (exact Hessian) or 1e-3 (projected Hessian). With the projected floor the stiffness stays finite
// although the true one grows without bound. This keeps the step's matrix well conditioned and does not change any
// minimum. Units: J/m^3, Pa.
#pragma once

#include "math/polar.hpp"
#include "model/tissue_model.hpp"

namespace softhand {

struct CorotationalMaterial {
  double mu = 0;                      ///< Pa
  double lambda = 0;                  ///< Pa
  double strain_limit_energy = 0;     ///< J/m^3, W_max > 0
  double strain_limit_stiffness = 0;  ///< J/m^3, k_s >= 0
  double strain_limit_ramp = 0;       ///< w, [0, 1]
};

/// Lame parameters from engineering constants. Throws std::invalid_argument unless E > 0, 0 <= nu < 0.5, W_max > 0, k_s
/// >= 0, 0 <= w <= 1 and all are finite.
CorotationalMaterial corotational_material(double youngs_modulus, double poisson_ratio, double strain_limit_energy,
                                           double strain_limit_stiffness, double strain_limit_ramp = 0);
CorotationalMaterial corotational_material(const Material& material);

/// The energy density and its first derivative at one deformation gradient, for single elements. The kernels of the
/// step compute the same law in lanes, with the Hessian (tissue_kernel_source.hpp).
struct CorotationalState {
  RotationSvd svd;
  Matrix3 rotation;                                             ///< R
  double quadratic = 0;                                         ///< W_q, J/m^3
  double density = 0;                                           ///< W, J/m^3
  double factor = 1;                                            ///< m of eq. 27
  double stiffening = 0;                                        ///< dm/dW_q, m^3/J
  Matrix3 stress_quadratic;                                     ///< dW_q/dF, Pa
  Matrix3 stress() const { return factor * stress_quadratic; }  ///< first Piola-Kirchhoff dW/dF, Pa
};

/// W of the mirror image, F = diag(1, 1, -1), without strain limiting, J/m^3. Tissue that is pressed flat or slightly
/// farther has a quarter of this.
inline double flip_density(const CorotationalMaterial& material) { return 4 * material.mu + 2 * material.lambda; }

CorotationalState evaluate_corotational(const CorotationalMaterial& material, const Matrix3& f);

}  // namespace softhand
