// The only source of the kernels of relaxation: see relaxation_kernel.hpp. One file per instruction set includes it.
#pragma once

#include "energies/element_lanes.hpp"
#include "energies/relaxation_kernel.hpp"

namespace softhand {
namespace {

// a : b of symmetric tensors.
SOFTHAND_INLINE Lanes product(const Lanes (&a)[6], const Lanes (&b)[6]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + 2.0 * (a[3] * b[3] + a[4] * b[4] + a[5] * b[5]);
}

SOFTHAND_INLINE void load_tensor(const double* from, Lanes (&tensor)[6]) {
  for (std::size_t k = 0; k < 6; ++k) tensor[k] = load_lanes(from + k * kElementBatch);
}

SOFTHAND_INLINE void green_strain(const Lanes3 (&f)[3], Lanes (&strain)[6]) {
  for (std::size_t k = 0; k < 3; ++k) strain[k] = 0.5 * (dot(f[k], f[k]) - 1.0);
  strain[3] = 0.5 * dot(f[1], f[2]);
  strain[4] = 0.5 * dot(f[2], f[0]);
  strain[5] = 0.5 * dot(f[0], f[1]);
}

// With dF = sum dx_a b_a^T, the second derivative of K E:E + 2 M:E is
//   sum_ab dx_a . [ (b_a . S b_b) 1 + K ((b_a . b_b) F F^T + (F b_b)(F b_a)^T) ] dx_b,   S = 2 (K E + M).
// The four b_a sum to zero, so the blocks of the nodes 1 to 3 determine those of node 0.
template <bool kGradient, bool kHessian, typename Row>
SOFTHAND_INLINE void evaluate_lanes(const RelaxationBatch& batch, std::size_t first, const double* positions,
                                    bool projected, BatchResult<Row>& result) {
  Lanes3 f[3], shape[3];
  load_deformation_gradient(batch, first, positions, f, shape);
  Lanes strain[6], linear[6], secant[6], stress[6];  // E, M, K E + 2 M, V times the second Piola-Kirchhoff stress
  green_strain(f, strain);
  load_tensor(batch.linear[0] + first, linear);
  const Lanes quadratic = load_lanes(batch.quadratic + first);
  for (std::size_t k = 0; k < 6; ++k) {
    const Lanes half = quadratic * strain[k] + linear[k];
    secant[k] = half + linear[k];
    stress[k] = 2.0 * half;
  }
  store(result.energy + first, product(secant, strain) + load_lanes(batch.constant + first));
  if constexpr (!kGradient && !kHessian) return;

  const auto stressed = [&](const Lanes3& b) -> Lanes3 {
    return {stress[0] * b.x + stress[5] * b.y + stress[4] * b.z, stress[5] * b.x + stress[1] * b.y + stress[3] * b.z,
            stress[4] * b.x + stress[3] * b.y + stress[2] * b.z};
  };
  const Lanes3 pull[3] = {stressed(shape[0]), stressed(shape[1]), stressed(shape[2])};  // S b
  const auto times = [](const auto(&matrix)[3], const auto& b) {
    return b.x * matrix[0] + b.y * matrix[1] + b.z * matrix[2];
  };
  if constexpr (kGradient) {
    const Lanes3 force[3] = {times(f, pull[0]), times(f, pull[1]), times(f, pull[2])};
    store_forces(force, first, result);
  }
  if constexpr (!kHessian) return;

  Row3<Row> columns[3], moved[3], gradient_of[3];  // of F; F b
  for (std::size_t k = 0; k < 3; ++k) columns[k] = rounded<Row>(f[k]), gradient_of[k] = rounded<Row>(shape[k]);
  for (std::size_t n = 0; n < 3; ++n) moved[n] = times(columns, gradient_of[n]);
  const Row stiffness = rounded<Row>(quadratic), none = stiffness - stiffness;
  Row3<Row> left[3] = {{none, none, none}, {none, none, none}, {none, none, none}};  // K F F^T
  const Row3<Row> scaled[3] = {stiffness * columns[0], stiffness * columns[1], stiffness * columns[2]};
  add_products(scaled, columns, left);
  store_blocks(first, result, [&](std::size_t n, std::size_t m, Row3<Row>(&column)[3]) {
    const Row both = dot(gradient_of[n], gradient_of[m]);
    for (std::size_t l = 0; l < 3; ++l) column[l] = both * left[l];
    const Row3<Row> one[1] = {stiffness * moved[m]}, other[1] = {moved[n]};
    add_products(one, other, column);
    if (projected) return;
    const Row same = rounded<Row>(dot(shape[n], pull[m]));
    column[0].x = column[0].x + same, column[1].y = column[1].y + same, column[2].z = column[2].z + same;
  });
}

SOFTHAND_INLINE void prefetch_values(const RelaxationBatch& next) {
  prefetch(next.quadratic);
  prefetch(next.linear);
  prefetch(next.constant);
}

double relaxation_energy(const RelaxationBatch* batches, std::size_t count, const double* positions,
                         const ElementOutput& output) {
  return evaluate_batches(
      batches, count, output, [](const RelaxationBatch& next) { prefetch_values(next); },
      [&](const auto& kind, const RelaxationBatch& batch, std::size_t first, auto& result) {
        evaluate_lanes<kind.gradient, kind.hessian>(batch, first, positions, output.projected, result);
      });
}

SOFTHAND_INLINE void strain_of(const RelaxationBatch& batch, std::size_t first, const double* positions,
                               Lanes (&strain)[6]) {
  Lanes3 f[3], shape[3];
  load_deformation_gradient(batch, first, positions, f, shape);
  green_strain(f, strain);
}

// The sum over the branches of V mu w/g |e^-a h + g (E - E_0)|^2 is K E:E + 2 M:E + C. Returns what the springs store
// at the step's start.
SOFTHAND_INLINE Lanes begin_lanes(RelaxationBatch& batch, std::size_t first, const double* springs,
                                  const Lanes (&start)[6], const RelaxationDecay (&decay)[kRelaxationBranches]) {
  Lanes quadratic = splat(0), constant = splat(0), stored = splat(0), relaxed[6];  // of V mu w e^-a h
  for (std::size_t k = 0; k < 6; ++k) relaxed[k] = splat(0);
  for (std::size_t i = 0; i < kRelaxationBranches; ++i) {
    const RelaxationDecay& d = decay[i];
    const Lanes stiffness = load_lanes(batch.stiffness[i] + first), kept = d.kept * stiffness;
    Lanes h[6];
    load_tensor(springs + 6 * i * kElementBatch + first, h);
    const Lanes energy = stiffness * product(h, h);
    stored = stored + energy;
    constant = constant + (d.kept * d.kept / d.taken) * energy;
    quadratic = quadratic + d.taken * stiffness;
    for (std::size_t k = 0; k < 6; ++k) relaxed[k] = relaxed[k] + kept * h[k];
  }
  Lanes both[6];
  for (std::size_t k = 0; k < 6; ++k) {
    const Lanes linear = relaxed[k] - quadratic * start[k];
    both[k] = linear + relaxed[k];
    store(batch.linear[k] + first, linear);
    store(batch.start[k] + first, start[k]);
  }
  store(batch.quadratic + first, quadratic);
  store(batch.constant + first, constant - product(both, start));
  return stored;
}

void relaxation_begin(RelaxationBatch* batches, std::size_t count, const double* springs, const double* positions,
                      const RelaxationDecay (&decay)[kRelaxationBranches]) {
  for (std::size_t b = 0; b < count; ++b, springs += kSpringBatch) {
    for (std::size_t first = 0; first < kElementBatch; first += kLanes) {
      Lanes strain[6];
      strain_of(batches[b], first, positions, strain);
      begin_lanes(batches[b], first, springs, strain, decay);
    }
  }
}

SOFTHAND_INLINE void end_lanes(RelaxationBatch& batch, std::size_t first, double* springs, const double* positions,
                               const RelaxationDecay (&decay)[kRelaxationBranches], double* stored, double* heat) {
  Lanes strain[6], start[6], change[6], all_heat = splat(0);
  strain_of(batch, first, positions, strain);
  load_tensor(batch.start[0] + first, start);
  for (std::size_t k = 0; k < 6; ++k) change[k] = strain[k] - start[k];
  const Lanes changes = product(change, change);
  for (std::size_t i = 0; i < kRelaxationBranches; ++i) {
    const RelaxationDecay& d = decay[i];
    double* spring = springs + 6 * i * kElementBatch + first;
    Lanes h[6];
    load_tensor(spring, h);
    all_heat = all_heat + load_lanes(batch.stiffness[i] + first) *
                              (d.heat[0] * product(h, h) + d.heat[1] * product(h, change) + d.heat[2] * changes);
    for (std::size_t k = 0; k < 6; ++k) store(spring + k * kElementBatch, d.kept * h[k] + d.taken * change[k]);
  }
  store(heat + first, all_heat);
  store(stored + first, begin_lanes(batch, first, springs, strain, decay));
}

void relaxation_end(RelaxationBatch* batches, std::size_t count, double* springs, const double* positions,
                    const RelaxationDecay (&decay)[kRelaxationBranches], double& stored, double& heat) {
  alignas(64) double stored_of[kElementBatch], heat_of[kElementBatch];
  for (std::size_t b = 0; b < count; ++b, springs += kSpringBatch) {
    if (b + 1 < count) {
      const RelaxationBatch& next = batches[b + 1];
      prefetch(next.shape);
      prefetch(next.node);
      prefetch(next.stiffness);
      prefetch_values(next);
      prefetch(next.start);
      prefetch(*reinterpret_cast<const double(*)[kSpringBatch]>(springs + kSpringBatch));
    }
    for (std::size_t first = 0; first < kElementBatch; first += kLanes)
      end_lanes(batches[b], first, springs, positions, decay, stored_of, heat_of);
    // In the order of the elements, so the sums do not depend on the width of the vectors.
    for (std::size_t lane = 0; lane < kElementBatch; ++lane) stored += stored_of[lane], heat += heat_of[lane];
  }
}

}  // namespace
}  // namespace softhand
