// Co-rotational elasticity with strain limiting: the material of the tissue (ES2725128A1 eqs. 22, 24, 27, 28, 30).
//
//   W_q(F) = mu |F - R|^2 + lambda/2 (tr(R^T F) - 3)^2,  R the polar rotation of F
//   W = W_q                                          for W_q <= W_max
//   W = W_q + 1/2 k_s (W_q/W_max - 1)^2              above: gradient times m = 1 + k_s/W_max (W_q/W_max - 1),
//                                                    Hessian gains k_s/W_max^2 g g^T with g = dW_q/dF
//
// The Hessian is m (2 mu 1 + lambda r r^T + sum_k c_k q_k q_k^T) + k_s/W_max^2 g g^T with r = vec R and three twists
// q_k (Smith, De Goes and Kim 2019): a multiple of the identity plus rank five. c_k = 2 (lambda (tr S - 3) - 2 mu)/(s_i
// + s_j); the twist's eigenvalue is 2 mu + c_k, and projecting is c_k >= -2 mu.
//
// Departures from the source: eq. 30 is read as P = U P(S) V^T. Only s_i + s_j -> 0 is singular; the sum is floored
// there, at 1e-9 (exact) or 1e-3 (projected: a finite stiffness where the true one grows without bound keeps the step's
// matrix well conditioned and bends no minimum). Units: J/m^3, Pa.
#pragma once

#include "math/polar.hpp"

namespace softhand {

struct CorotationalMaterial {
  double mu = 0;                      ///< Pa
  double lambda = 0;                  ///< Pa
  double strain_limit_energy = 0;     ///< J/m^3, W_max > 0
  double strain_limit_stiffness = 0;  ///< J/m^3, k_s >= 0
};

/// Lame parameters from engineering constants; std::invalid_argument unless E > 0, 0 <= nu < 0.5, W_max > 0, k_s >= 0,
/// all finite.
CorotationalMaterial corotational_material(double youngs_modulus, double poisson_ratio, double strain_limit_energy,
                                           double strain_limit_stiffness);

/// The density and its first derivative at one deformation gradient: for single elements. The step's kernels have the
/// same law in lanes, with the Hessian (tissue_kernel_source.hpp).
struct CorotationalState {
  RotationSvd svd;
  Matrix3 rotation;                                             ///< R
  double density = 0;                                           ///< W, J/m^3
  double factor = 1;                                            ///< m of eq. 27
  Matrix3 stress_quadratic;                                     ///< dW_q/dF, Pa
  Matrix3 stress() const { return factor * stress_quadratic; }  ///< first Piola-Kirchhoff dW/dF, Pa
};

/// W of the mirror image, F = diag(1, 1, -1), without strain limiting, J/m^3. What is pressed flat and a little further
/// holds a quarter.
inline double flip_density(const CorotationalMaterial& material) { return 4 * material.mu + 2 * material.lambda; }

CorotationalState evaluate_corotational(const CorotationalMaterial& material, const Matrix3& f);

}  // namespace softhand
