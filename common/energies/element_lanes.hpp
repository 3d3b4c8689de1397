// What kernels of tetrahedra share: gathering positions, scattering forces and blocks. Kernels are compiled once per
// instruction set (math/lanes.hpp), so everything has internal linkage, and nothing of the standard library or Eigen is
// instantiated here.
#pragma once

#include "energies/element_batch.hpp"
#include "math/lanes.hpp"

namespace softhand {
namespace {

static_assert(kElementBatch % kLanes == 0);
constexpr std::size_t element_slot(std::size_t row, std::size_t column) { return row * (row + 1) / 2 + column; }

SOFTHAND_INLINE Lanes gather(const double* base, const std::int32_t* index, std::size_t component) {
  Lanes result;
#pragma GCC unroll 4
  for (std::size_t k = 0; k < kVectorsPerLanes; ++k) {
    const std::int32_t* of = index + k * kVectorWidth;
    const auto at = [&](std::size_t i) {
      return base[3 * static_cast<std::ptrdiff_t>(of[i]) + static_cast<std::ptrdiff_t>(component)];
    };
#if defined(__AVX512F__)
    result.part[k] = Vector{at(0), at(1), at(2), at(3), at(4), at(5), at(6), at(7)};
#elif defined(__AVX2__)
    result.part[k] = Vector{at(0), at(1), at(2), at(3)};
#else
    result.part[k] = Vector{at(0), at(1)};
#endif
  }
  return result;
}

// Results of a batch, to be added to gradient and Hessian. The Hessian's blocks consist of rows of type `Row`: Lanes,
// or Singles if single precision is enough.
template <typename Row>
struct alignas(64) BatchResult;
template <>
struct alignas(64) BatchResult<Lanes> {
  using Scalar = double;
  double energy[kElementBatch];
  double force[12][kElementBatch];     // gradient, node by node
  double block[10][9][kElementBatch];  // as ElementBatch::slot, column-major
};
template <>
struct alignas(64) BatchResult<Singles> {
  using Scalar = float;
  double energy[kElementBatch];
  double force[12][kElementBatch];
  float block[10][9][kElementBatch];
};

// Adds the sum over k of left_k right_k^T to a 3x3 block. `column[l]` holds the entries (i, l).
template <typename Row, std::size_t kTerms>
SOFTHAND_INLINE void add_products(const Row3<Row> (&left)[kTerms], const Row3<Row> (&right)[kTerms],
                                  Row3<Row> (&column)[3]) {
#pragma GCC unroll 5
  for (std::size_t k = 0; k < kTerms; ++k) {
    column[0] = column[0] + right[k].x * left[k];
    column[1] = column[1] + right[k].y * left[k];
    column[2] = column[2] + right[k].z * left[k];
  }
}

// F, column by column, and the gradients of the shape functions of nodes 1 to 3.
SOFTHAND_INLINE void load_deformation_gradient(const ElementBatch& batch, std::size_t first, const double* positions,
                                               Lanes3 (&f)[3], Lanes3 (&shape)[3]) {
  Lanes3 point[4];
#pragma GCC unroll 4
  for (std::size_t n = 0; n < 4; ++n) {
    const std::int32_t* node = batch.node[n] + first;
    point[n] = {gather(positions, node, 0), gather(positions, node, 1), gather(positions, node, 2)};
  }
#pragma GCC unroll 3
  for (std::size_t n = 0; n < 3; ++n) {
    shape[n] = {load_lanes(batch.shape[3 * n] + first), load_lanes(batch.shape[3 * n + 1] + first),
                load_lanes(batch.shape[3 * n + 2] + first)};
    const Lanes3 edge = point[n + 1] - point[0];
    if (n == 0) {
      f[0] = shape[n].x * edge, f[1] = shape[n].y * edge, f[2] = shape[n].z * edge;
    } else {
      f[0] = f[0] + shape[n].x * edge, f[1] = f[1] + shape[n].y * edge, f[2] = f[2] + shape[n].z * edge;
    }
  }
}

// The force on node 0 balances those on the others, which are `force`.
template <typename Result>
SOFTHAND_INLINE void store_forces(const Lanes3 (&force)[3], std::size_t first, Result& result) {
#pragma GCC unroll 3
  for (std::size_t n = 0; n < 3; ++n) {
    store(result.force[3 * n + 3] + first, force[n].x);
    store(result.force[3 * n + 4] + first, force[n].y);
    store(result.force[3 * n + 5] + first, force[n].z);
  }
  const Lanes3 sum = -(force[0] + force[1] + force[2]);
  store(result.force[0] + first, sum.x);
  store(result.force[1] + first, sum.y);
  store(result.force[2] + first, sum.z);
}

// Stores a 3x3 block, column by column.
template <typename Row>
SOFTHAND_INLINE void store_block(std::size_t slot, const Row3<Row> (&column)[3], std::size_t first,
                                 BatchResult<Row>& result) {
#pragma GCC unroll 3
  for (std::size_t l = 0; l < 3; ++l) {
    store(result.block[slot][3 * l] + first, column[l].x);
    store(result.block[slot][3 * l + 1] + first, column[l].y);
    store(result.block[slot][3 * l + 2] + first, column[l].z);
  }
}

// Stores the Hessian of an element. Calls block(n, m, column) for its blocks (n + 1, m + 1), n >= m. Its rows sum to
// zero. So block (n + 1, 0) = -sum of (n + 1, 1) to (n + 1, 3), and likewise for the corner block (0, 0).
template <typename Row, typename Block>
SOFTHAND_INLINE void store_blocks(std::size_t first, BatchResult<Row>& result, const Block& block) {
  Row3<Row> to_first[3][3];
#pragma GCC unroll 3
  for (std::size_t n = 0; n < 3; ++n) {
#pragma GCC unroll 3
    for (std::size_t m = 0; m <= n; ++m) {
      Row3<Row> column[3];
      block(n, m, column);
      store_block(element_slot(n + 1, m + 1), column, first, result);
#pragma GCC unroll 3
      for (std::size_t l = 0; l < 3; ++l) to_first[n][l] = m == 0 ? -column[l] : to_first[n][l] - column[l];
      if (m == n) continue;
      to_first[m][0] = to_first[m][0] - Row3<Row>{column[0].x, column[1].x, column[2].x};
      to_first[m][1] = to_first[m][1] - Row3<Row>{column[0].y, column[1].y, column[2].y};
      to_first[m][2] = to_first[m][2] - Row3<Row>{column[0].z, column[1].z, column[2].z};
    }
  }
  Row3<Row> corner[3];
#pragma GCC unroll 3
  for (std::size_t n = 0; n < 3; ++n) store_block(element_slot(n + 1, 0), to_first[n], first, result);
#pragma GCC unroll 3
  for (std::size_t l = 0; l < 3; ++l) corner[l] = -(to_first[0][l] + to_first[1][l] + to_first[2][l]);
  // This block is symmetric in exact arithmetic. The mean of the block and its transpose is symmetric in floating point
  // too.
  const Row half = rounded<Row>(splat(0.5));
  const Row xy = half * (corner[0].y + corner[1].x), xz = half * (corner[0].z + corner[2].x),
            yz = half * (corner[1].z + corner[2].y);
  const Row3<Row> symmetric[3] = {{corner[0].x, xy, xz}, {xy, corner[1].y, yz}, {xz, yz, corner[2].z}};
  store_block(element_slot(0, 0), symmetric, first, result);
}

// Adds the blocks of a batch: block by block, and inside a block element by element. So the order does not depend on
// the width of the vectors.
template <typename Row>
SOFTHAND_INLINE void scatter_blocks(const ElementBatch& batch, const BatchResult<Row>& result, double* blocks) {
  for (std::size_t slot = 0; slot < 10; ++slot) {
    const std::int32_t* index = batch.slot[slot];
    const auto& entries = result.block[slot];
    for (std::size_t first = 0; first < batch.count; first += kVectorWidth) {
      Vector tile[8 / kVectorWidth][kVectorWidth];
#pragma GCC unroll 4
      for (std::size_t t = 0; t < 8 / kVectorWidth; ++t) {
#pragma GCC unroll 8
        for (std::size_t k = 0; k < kVectorWidth; ++k) tile[t][k] = load(&entries[t * kVectorWidth + k][first]);
        transpose(tile[t]);
      }
#pragma GCC unroll 8
      for (std::size_t lane = 0; lane < kVectorWidth; ++lane) {
        if (first + lane >= batch.count) break;
        double* stored = blocks + 9 * static_cast<std::ptrdiff_t>(index[first + lane]);
#pragma GCC unroll 4
        for (std::size_t t = 0; t < 8 / kVectorWidth; ++t)
          store(stored + t * kVectorWidth, load(stored + t * kVectorWidth) + tile[t][lane]);
        stored[8] += entries[8][first + lane];
      }
    }
  }
}

template <bool kGradient, bool kHessian>
struct Outputs {
  static constexpr bool gradient = kGradient, hessian = kHessian;
};

template <typename Row, bool kGradient, bool kHessian, typename Batch, typename Evaluate>
double evaluate_as(const Batch* batches, std::size_t count, const ElementOutput& output, const Evaluate& evaluate) {
  double energy = 0;
  BatchResult<Row> result;
  for (const Batch* batch = batches; batch != batches + count; ++batch) {
    for (std::size_t first = 0; first < batch->count; first += kLanes)
      evaluate(Outputs<kGradient, kHessian>{}, *batch, first, result);
    for (std::size_t lane = 0; lane < batch->count; ++lane) energy += result.energy[lane];
    if constexpr (kGradient) {
      for (std::size_t n = 0; n < 4; ++n) {
        for (std::size_t lane = 0; lane < batch->count; ++lane) {
          double* stored = output.gradient + 3 * static_cast<std::ptrdiff_t>(batch->node[n][lane]);
          for (std::size_t c = 0; c < 3; ++c) stored[c] += result.force[3 * n + c][lane];
        }
      }
    }
    if constexpr (kHessian) scatter_blocks(*batch, result, output.blocks);
  }
  return energy;
}

// Calls evaluate(Outputs, batch, first, result) for the lanes from `first` on of each batch. Adds the result to the
// output, batch by batch. Returns the energy.
template <typename Batch, typename Evaluate>
double evaluate_batches(const Batch* batches, std::size_t count, const ElementOutput& output,
                        const Evaluate& evaluate) {
  if (output.blocks == nullptr) {
    return output.gradient != nullptr ? evaluate_as<Lanes, true, false>(batches, count, output, evaluate)
                                      : evaluate_as<Lanes, false, false>(batches, count, output, evaluate);
  }
  if (output.gradient == nullptr) return evaluate_as<Lanes, false, true>(batches, count, output, evaluate);
  return output.single_blocks ? evaluate_as<Singles, true, true>(batches, count, output, evaluate)
                              : evaluate_as<Lanes, true, true>(batches, count, output, evaluate);
}

}  // namespace
}  // namespace softhand
