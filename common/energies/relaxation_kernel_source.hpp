// The only source of the kernels of relaxation: see relaxation_kernel.hpp. One file per instruction set includes it.
#pragma once

#include "energies/relaxation_kernel.hpp"
#include "energies/tissue_lanes.hpp"

namespace softhand {
namespace {

constexpr double kLeastStretch = 0.1;  // in S_e, of flat and inverted tissue

// The elastic law at a state: S_e, E and W.
struct ElasticPoint {
  Lanes stress[6], strain[6], density;
};

// The inverse of the symmetric matrix `s` in the lanes of `which`, with bounded eigenvalues.
SOFTHAND_INLINE void bounded_inverse(const Lanes (&s)[6], const Choice& which, Lanes (&inverse)[6]) {
  Lanes stretch[3] = {s[0], s[1], s[2]}, beside[3] = {s[3], s[4], s[5]};
  Lanes3 axis[3];
  lane_axes(stretch, beside, axis);
  Lanes sum[6];
  for (std::size_t k = 0; k < 6; ++k) sum[k] = splat(0);
  for (std::size_t j = 0; j < 3; ++j) {
    const Lanes3 &v = axis[j], scaled = (splat(1.0) / maximum(absolute(stretch[j]), splat(kLeastStretch))) * v;
    sum[0] = sum[0] + scaled.x * v.x, sum[1] = sum[1] + scaled.y * v.y, sum[2] = sum[2] + scaled.z * v.z;
    sum[3] = sum[3] + scaled.y * v.z, sum[4] = sum[4] + scaled.z * v.x, sum[5] = sum[5] + scaled.x * v.y;
  }
  for (std::size_t k = 0; k < 6; ++k) inverse[k] = select(which, sum[k], inverse[k]);
}

// S_e = F^-1 dW/dF = m (2 mu 1 + (lambda tr - 2 mu) S^-1), with the stretch S = R^T F. Two bounds keep it below 2 mu m.
// So no A makes the energy fall without bound. A principal stretch in S^-1 is at least `kLeastStretch`, and that of
// inverted tissue counts without its sign. The factor of S^-1 is at most 0.
SOFTHAND_INLINE ElasticPoint elastic_point(const TissueBatch& batch, std::size_t first, const double* positions) {
  Lanes3 f[3], shape[3];
  load_deformation_gradient(batch, first, positions, f, shape);
  const LaneLaw law = lane_law(batch, first, f);
  const auto& r = law.rotation;
  const Lanes s[6] = {dot(r[0], f[0]), dot(r[1], f[1]), dot(r[2], f[2]),
                      dot(r[1], f[2]), dot(r[0], f[2]), dot(r[0], f[1])};
  const Lanes cofactor[6] = {s[1] * s[2] - s[3] * s[3], s[0] * s[2] - s[4] * s[4], s[0] * s[1] - s[5] * s[5],
                             s[4] * s[5] - s[0] * s[3], s[3] * s[5] - s[1] * s[4], s[3] * s[4] - s[2] * s[5]};
  const Lanes volume = s[0] * cofactor[0] + s[5] * cofactor[5] + s[4] * cofactor[4];
  Lanes inverse[6];
#pragma GCC unroll 6
  for (std::size_t k = 0; k < 6; ++k) inverse[k] = cofactor[k] / volume;
  // The product of the two largest stretches is at most a quarter of the squared sum.
  const Lanes sum = s[0] + s[1] + s[2];
  const Choice flat = !(volume > (0.25 * kLeastStretch) * sum * sum);
  if (any(flat)) bounded_inverse(s, flat, inverse);
  const Lanes factor = law.factor();
  const Lanes isotropic = factor * (2.0 * law.mu);
  const Lanes slope = -maximum(isotropic - factor * (law.lambda * law.trace), splat(0.0));
  ElasticPoint point;
  point.density = law.density();
#pragma GCC unroll 3
  for (std::size_t k = 0; k < 3; ++k) {
    point.stress[k] = isotropic + slope * inverse[k];
    point.stress[k + 3] = slope * inverse[k + 3];
    point.strain[k] = 0.5 * (dot(f[k], f[k]) - 1.0);
  }
  point.strain[3] = 0.5 * dot(f[1], f[2]);
  point.strain[4] = 0.5 * dot(f[2], f[0]);
  point.strain[5] = 0.5 * dot(f[0], f[1]);
  return point;
}

// a : b of symmetric tensors.
SOFTHAND_INLINE Lanes product(const Lanes (&a)[6], const Lanes (&b)[6]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + 2.0 * (a[3] * b[3] + a[4] * b[4] + a[5] * b[5]);
}

SOFTHAND_INLINE void load_tensor(const double* from, Lanes (&tensor)[6]) {
#pragma GCC unroll 6
  for (std::size_t k = 0; k < 6; ++k) tensor[k] = load_lanes(from + k * kElementBatch);
}

SOFTHAND_INLINE void store_tensor(double* to, const Lanes (&tensor)[6]) {
#pragma GCC unroll 6
  for (std::size_t k = 0; k < 6; ++k) store(to + k * kElementBatch, tensor[k]);
}

// Sets the function of a step that starts at `start`. Its value there is what the lasting stress stores; returns it.
SOFTHAND_INLINE Lanes begin_lanes(const TissueBatch& tissue, RelaxationBatch& batch, std::size_t first,
                                  const double* memory, const ElasticPoint& start,
                                  const RelaxationDecay (&decay)[kRelaxationBranches]) {
  const Lanes volume = load_lanes(tissue.volume + first);
  Lanes lasting = splat(1), rising = splat(0), early = splat(0), stress[6];  // sums of c, c (1 - g) and c (g - e^-a)
  for (std::size_t k = 0; k < 6; ++k) stress[k] = splat(0);
  for (std::size_t i = 0; i < kRelaxationBranches; ++i) {
    const Lanes weight = load_lanes(batch.weight[i] + first), kept = decay[i].kept * weight;
    Lanes d[6];
    load_tensor(memory + 6 * i * kElementBatch, d);
    lasting = lasting - weight;
    rising = rising + decay[i].late * weight;
    early = early + decay[i].early * weight;
#pragma GCC unroll 6
    for (std::size_t k = 0; k < 6; ++k) stress[k] = stress[k] - kept * d[k];
  }
#pragma GCC unroll 6
  for (std::size_t k = 0; k < 6; ++k) stress[k] = volume * (stress[k] - early * start.stress[k]);
  const Lanes stored = volume * lasting * start.density, scaled = volume * (splat(1) - rising);
  store(batch.volume + first, scaled);
  store_tensor(batch.stress[0] + first, stress);
  store(batch.constant + first, stored - scaled * start.density - product(stress, start.strain));
  store_tensor(batch.elastic_stress[0] + first, start.stress);
  return stored;
}

void relaxation_begin(const TissueBatch* tissue, RelaxationBatch* batches, std::size_t count, const double* memory,
                      const double* positions, const RelaxationDecay (&decay)[kRelaxationBranches]) {
  for (std::size_t b = 0; b < count; ++b, memory += kMemoryBatch) {
    for (std::size_t first = 0; first < kElementBatch; first += kLanes)
      begin_lanes(tissue[b], batches[b], first, memory + first, elastic_point(tissue[b], first, positions), decay);
  }
}

SOFTHAND_INLINE void end_lanes(const TissueBatch& tissue, RelaxationBatch& batch, std::size_t first, double* memory,
                               const double* positions, const RelaxationDecay (&decay)[kRelaxationBranches],
                               double (&stored)[kElementBatch]) {
  const ElasticPoint end = elastic_point(tissue, first, positions);
  Lanes start[6];
  load_tensor(batch.elastic_stress[0] + first, start);
  for (std::size_t i = 0; i < kRelaxationBranches; ++i) {
    double* const of_branch = memory + 6 * i * kElementBatch;
    Lanes d[6];
    load_tensor(of_branch, d);
#pragma GCC unroll 6
    for (std::size_t k = 0; k < 6; ++k)
      d[k] = decay[i].kept * d[k] + decay[i].late * end.stress[k] + decay[i].early * start[k];
    store_tensor(of_branch, d);
  }
  store(stored + first, begin_lanes(tissue, batch, first, memory, end, decay));
}

double relaxation_end(const TissueBatch* tissue, RelaxationBatch* batches, std::size_t count, double* memory,
                      const double* positions, const RelaxationDecay (&decay)[kRelaxationBranches]) {
  double sum = 0;
  alignas(64) double stored[kElementBatch];
  for (std::size_t b = 0; b < count; ++b, memory += kMemoryBatch) {
    if (b + 1 < count) {
      const RelaxationBatch& next = batches[b + 1];
      prefetch(tissue[b + 1].shape);
      prefetch(tissue[b + 1].node);
      prefetch_values(tissue[b + 1]);
      prefetch(next.weight);
      prefetch(next.volume);
      prefetch(next.stress);
      prefetch(next.constant);
      prefetch(next.elastic_stress);
      prefetch(*reinterpret_cast<const double(*)[kMemoryBatch]>(memory + kMemoryBatch));
    }
    for (std::size_t first = 0; first < kElementBatch; first += kLanes)
      end_lanes(tissue[b], batches[b], first, memory + first, positions, decay, stored);
    // In the order of the elements, so the sum does not depend on the width of the vectors.
    for (std::size_t lane = 0; lane < tissue[b].count; ++lane) sum += stored[lane];
  }
  return sum;
}

}  // namespace
}  // namespace softhand
