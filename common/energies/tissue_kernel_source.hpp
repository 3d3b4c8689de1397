// The only source of the tissue's kernels: see tissue_kernel.hpp. One file per instruction set includes it and wraps
// `tissue_energy`. Everything has internal linkage, and nothing of the standard library or Eigen is instantiated here.
// Otherwise the linker could give the whole program a shared function with this file's instructions.
#pragma once

#include "energies/relaxation_kernel.hpp"
#include "energies/tissue_lanes.hpp"

namespace softhand {
namespace {

constexpr double kLeastAlong = 1e-3;  // least stiffness with relaxation along an axis, relative to that without it

// Symmetric tensors have their six entries in this order: xx, yy, zz, yz, zx, xy.
template <typename Row>
SOFTHAND_INLINE Row3<Row> product(const Row (&tensor)[6], const Row3<Row>& b) {
  return {tensor[0] * b.x + tensor[5] * b.y + tensor[4] * b.z, tensor[5] * b.x + tensor[1] * b.y + tensor[3] * b.z,
          tensor[4] * b.x + tensor[3] * b.y + tensor[2] * b.z};
}

template <bool kRelaxes, bool kGradient, bool kHessian, typename Row>
SOFTHAND_INLINE void evaluate_lanes(const TissueBatch& batch, const RelaxationBatch* relaxation, std::size_t first,
                                    const double* positions, bool projected, BatchResult<Row>& result) {
  Lanes3 f[3], shape[3];
  load_deformation_gradient(batch, first, positions, f, shape);
  const LaneLaw law = lane_law(batch, first, f);
  const Lanes volume = load_lanes((kRelaxes ? relaxation->volume : batch.volume) + first);
  const auto times = [](const auto(&matrix)[3], const auto& b) {
    return b.x * matrix[0] + b.y * matrix[1] + b.z * matrix[2];
  };
  Lanes energy = volume * law.density();
  Lanes relaxed[6];        // V A
  Lanes3 relaxed_pull[3];  // V A b
  if constexpr (kRelaxes) {
#pragma GCC unroll 6
    for (std::size_t k = 0; k < 6; ++k) relaxed[k] = load_lanes(relaxation->stress[k] + first);
    const Lanes diagonal = relaxed[0] * (dot(f[0], f[0]) - 1.0) + relaxed[1] * (dot(f[1], f[1]) - 1.0) +
                           relaxed[2] * (dot(f[2], f[2]) - 1.0);
    const Lanes beside = relaxed[3] * dot(f[1], f[2]) + relaxed[4] * dot(f[2], f[0]) + relaxed[5] * dot(f[0], f[1]);
    energy = energy + (0.5 * diagonal + beside + load_lanes(relaxation->constant + first));
  }
  store(result.energy + first, energy);
  if constexpr (!kGradient && !kHessian) return;

  const Lanes weight = volume * law.factor();
  // dW_q/dF.
  Lanes3 stress[3];
#pragma GCC unroll 3
  for (std::size_t j = 0; j < 3; ++j)
    stress[j] = (2.0 * law.mu) * law.strain[j] + (law.lambda * law.trace) * law.rotation[j];
  // dW_q/dF b for the shape gradients b of nodes 1 to 3.
  Lanes3 pull[3];
#pragma GCC unroll 3
  for (std::size_t n = 0; n < 3; ++n) {
    pull[n] = times(stress, shape[n]);
    if constexpr (kRelaxes) relaxed_pull[n] = product(relaxed, shape[n]);
  }
  if constexpr (kGradient) {
    Lanes3 force[3];
#pragma GCC unroll 3
    for (std::size_t n = 0; n < 3; ++n) {
      force[n] = weight * pull[n];
      if constexpr (kRelaxes) force[n] = force[n] + times(f, relaxed_pull[n]);
    }
    store_forces(force, first, result);
  }
  if constexpr (!kHessian) return;

  Row3<Row> v[3], u[3], turn[3];
  const auto& r = law.rotation;
  Row stretch[3] = {rounded<Row>(dot(r[0], f[0])), rounded<Row>(dot(r[1], f[1])), rounded<Row>(dot(r[2], f[2]))};
  Row shear[3] = {rounded<Row>(dot(r[1], f[2])), rounded<Row>(dot(r[0], f[2])), rounded<Row>(dot(r[0], f[1]))};
  lane_axes(stretch, shear, v);
#pragma GCC unroll 3
  for (std::size_t k = 0; k < 3; ++k) turn[k] = rounded<Row>(law.rotation[k]);
#pragma GCC unroll 3
  for (std::size_t k = 0; k < 3; ++k) u[k] = times(turn, v[k]);
  const Lanes stiffness = 2.0 * law.mu;
  const Row row_weight = rounded<Row>(weight);
  Row isotropic = row_weight * rounded<Row>(stiffness);
  const Row none = isotropic - isotropic;
  Row lowest[3];  // of the twists, see below
  if constexpr (kRelaxes) {
    // A : E adds the stiffness (b_n . V A b_m) 1. In the axes of the stretch, its entries beside the diagonal and the
    // sums of their magnitudes on it are positive semi-definite. The rest is diagonal: with 2 mu it is `along`. A shift
    // keeps that positive.
    Row tensor[6];
    for (std::size_t k = 0; k < 6; ++k) tensor[k] = rounded<Row>(relaxed[k]);
    const Row3<Row> moved[3] = {product(tensor, v[0]), product(tensor, v[1]), product(tensor, v[2])};
    const Row beside[3] = {absolute(dot(v[1], moved[2])), absolute(dot(v[2], moved[0])), absolute(dot(v[0], moved[1]))};
    Row along[3], shift = none;
    for (std::size_t k = 0; k < 3; ++k) {
      along[k] = isotropic + dot(v[k], moved[k]) - beside[(k + 1) % 3] - beside[(k + 2) % 3];
      shift = maximum(shift, rounded<Row>(splat(kLeastAlong)) * isotropic - along[k]);
    }
    if (projected) isotropic = isotropic + shift;
    for (std::size_t k = 0; k < 3; ++k) along[k] = along[k] + shift;
    for (std::size_t k = 0; k < 3; ++k) {
      const Row &p = along[k == 2 ? 1 : 0], &q = along[k == 0 ? 1 : 2];
      lowest[k] = -(p * q / (p + q));
    }
  } else {
    lowest[0] = lowest[1] = lowest[2] = row_weight * rounded<Row>(-law.mu);
  }
  // Half of c_k, because the twists do not have unit length. Floors as described in corotational.hpp. The stiffness is
  // p and q along v_i and v_j, both 2 mu without relaxation. It is positive with a twist if c_k >= -2 p q/(p + q).
  const Row numerator = rounded<Row>(law.lambda * law.trace - stiffness);
  const Row floor = rounded<Row>(splat(projected ? 1e-3 : 1e-9));
  const auto twist = [&](std::size_t k, std::size_t i, std::size_t j) {
    const Row half = row_weight * (numerator / maximum(stretch[i] + stretch[j], floor));
    return projected ? maximum(half, lowest[k]) : half;
  };
  const Row term[5] = {rounded<Row>(weight * law.lambda), twist(0, 0, 1), twist(1, 0, 2), twist(2, 1, 2),
                       rounded<Row>(volume * law.slope() / law.limit_energy *
                                    select(law.beyond > 0.0, splat(1.0), law.ramp_rate * law.along))};
  // R b, the twists (u_i v_j^T - u_j v_i^T) b and dW_q/dF b.
  Row3<Row> factor_of[3][5], gradient_of[3], relaxed_of[3];
#pragma GCC unroll 3
  for (std::size_t n = 0; n < 3; ++n) {
    gradient_of[n] = rounded<Row>(shape[n]);
    if constexpr (kRelaxes) relaxed_of[n] = rounded<Row>(relaxed_pull[n]);
    const Row b[3] = {dot(v[0], gradient_of[n]), dot(v[1], gradient_of[n]), dot(v[2], gradient_of[n])};
    factor_of[n][0] = times(turn, gradient_of[n]);
    factor_of[n][1] = b[1] * u[0] - b[0] * u[1];
    factor_of[n][2] = b[2] * u[0] - b[0] * u[2];
    factor_of[n][3] = b[2] * u[1] - b[1] * u[2];
    factor_of[n][4] = rounded<Row>(pull[n]);
  }
  Row3<Row> scaled[3][5];
#pragma GCC unroll 3
  for (std::size_t n = 0; n < 3; ++n) {
#pragma GCC unroll 5
    for (std::size_t k = 0; k < 5; ++k) scaled[n][k] = term[k] * factor_of[n][k];
  }
  store_blocks(first, result, [&](std::size_t n, std::size_t m, Row3<Row>(&column)[3]) {
    Row same = isotropic * dot(gradient_of[n], gradient_of[m]);
    if constexpr (kRelaxes) same = same + dot(gradient_of[n], relaxed_of[m]);
    column[0] = {same, none, none}, column[1] = {none, same, none}, column[2] = {none, none, same};
    add_products(scaled[n], factor_of[m], column);
  });
}

double tissue_energy(const TissueBatch* batches, const RelaxationBatch* relaxation, std::size_t count,
                     const double* positions, const ElementOutput& output) {
  if (relaxation == nullptr) {
    return evaluate_batches(
        batches, count, output, [](const TissueBatch& next) { prefetch_values(next); },
        [&](const auto& kind, const TissueBatch& batch, std::size_t first, auto& result) {
          evaluate_lanes<false, kind.gradient, kind.hessian>(batch, nullptr, first, positions, output.projected,
                                                             result);
        });
  }
  return evaluate_batches(
      batches, count, output,
      [&](const TissueBatch& next) {
        prefetch_values(next);
        const RelaxationBatch& of_next = relaxation[&next - batches];
        prefetch(of_next.volume);
        prefetch(of_next.stress);
        prefetch(of_next.constant);
      },
      [&](const auto& kind, const TissueBatch& batch, std::size_t first, auto& result) {
        evaluate_lanes<true, kind.gradient, kind.hessian>(batch, relaxation + (&batch - batches), first, positions,
                                                          output.projected, result);
      });
}

}  // namespace
}  // namespace softhand
