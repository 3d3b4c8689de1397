// What kernels of tetrahedra share: gathering positions, scattering forces and blocks. Kernels are compiled once per
// instruction set (math/lanes.hpp). So everything has internal linkage, and this file instantiates nothing of the
// standard library or Eigen.
#pragma once

#include "energies/element_batch.hpp"
#include "math/lanes.hpp"

namespace softhand {
namespace {

static_assert(kElementBatch % kLanes == 0);
constexpr std::size_t element_slot(std::size_t row, std::size_t column) { return row * (row + 1) / 2 + column; }

// Two doubles side by side in memory: x and y of a node.
typedef double Pair __attribute__((vector_size(16)));
typedef double UnalignedPair __attribute__((vector_size(16), aligned(8), may_alias));
SOFTHAND_INLINE Pair load_pair(const double* from) { return *reinterpret_cast<const UnalignedPair*>(from); }
SOFTHAND_INLINE void store_pair(double* to, Pair value) { *reinterpret_cast<UnalignedPair*>(to) = value; }

// Swaps the odd entries of `even` with the even entries of `odd`. This turns the pairs of even and of odd lanes into
// the first and the second entries of all lanes, and back.
SOFTHAND_INLINE void swap_pairs(Vector& even, Vector& odd) {
#if defined(__AVX512F__)
  const VectorMask low{0, 8, 2, 10, 4, 12, 6, 14}, high{1, 9, 3, 11, 5, 13, 7, 15};
#elif defined(__AVX2__)
  const VectorMask low{0, 4, 2, 6}, high{1, 5, 3, 7};
#else
  const VectorMask low{0, 2}, high{1, 3};
#endif
  const Vector first = __builtin_shuffle(even, odd, low);
  odd = __builtin_shuffle(even, odd, high);
  even = first;
}

// The positions of a node of each lane. x and y are loaded together.
SOFTHAND_INLINE Lanes3 gather(const double* positions, const std::int32_t* node) {
  Lanes3 result;
#pragma GCC unroll 4
  for (std::size_t k = 0; k < kVectorsPerLanes; ++k) {
    const double* at[kVectorWidth];
#pragma GCC unroll 8
    for (std::size_t i = 0; i < kVectorWidth; ++i)
      at[i] = positions + 3 * static_cast<std::ptrdiff_t>(node[k * kVectorWidth + i]);
#if defined(__AVX512F__)
    const auto four = [&](std::size_t i) {
      return __builtin_shufflevector(load_pair(at[i]), load_pair(at[i + 2]), 0, 1, 2, 3);
    };
    const auto all = [&](std::size_t i) {
      return __builtin_shufflevector(four(i), four(i + 4), 0, 1, 2, 3, 4, 5, 6, 7);
    };
    Vector even = all(0), odd = all(1);
    result.z.part[k] = Vector{at[0][2], at[1][2], at[2][2], at[3][2], at[4][2], at[5][2], at[6][2], at[7][2]};
#elif defined(__AVX2__)
    const auto all = [&](std::size_t i) {
      return __builtin_shufflevector(load_pair(at[i]), load_pair(at[i + 2]), 0, 1, 2, 3);
    };
    Vector even = all(0), odd = all(1);
    result.z.part[k] = Vector{at[0][2], at[1][2], at[2][2], at[3][2]};
#else
    Vector even = load_pair(at[0]), odd = load_pair(at[1]);
    result.z.part[k] = Vector{at[0][2], at[1][2]};
#endif
    swap_pairs(even, odd);
    result.x.part[k] = even;
    result.y.part[k] = odd;
  }
  return result;
}

// Forces on the nodes of a batch: by node and lane. x and y of a lane lie side by side at its `pair_place`.
struct alignas(64) BatchForces {
  double xy[4][2 * kElementBatch];
  double z[4][kElementBatch];
};
// In each vector's width of lanes, the even lanes come first.
constexpr std::size_t pair_place(std::size_t lane) {
  const std::size_t in_vector = lane % kVectorWidth;
  return lane - in_vector + (in_vector % 2 == 0 ? 0 : kVectorWidth / 2) + in_vector / 2;
}

SOFTHAND_INLINE void store_force(std::size_t node, const Lanes3& force, std::size_t first, BatchForces& forces) {
#pragma GCC unroll 4
  for (std::size_t k = 0; k < kVectorsPerLanes; ++k) {
    Vector even = force.x.part[k], odd = force.y.part[k];
    swap_pairs(even, odd);
    double* to = forces.xy[node] + 2 * (first + k * kVectorWidth);
    store(to, even);
    store(to + kVectorWidth, odd);
  }
  store(forces.z[node] + first, force.z);
}

// Results of a batch, to be added to gradient and Hessian. The Hessian's blocks consist of rows of type `Row`: Lanes,
// or Singles if single precision is enough.
template <typename Row>
struct alignas(64) BatchResult;
template <>
struct alignas(64) BatchResult<Lanes> {
  using Scalar = double;
  double energy[kElementBatch];
  BatchForces forces;                  // gradient
  double block[10][9][kElementBatch];  // as ElementBatch::slot, column-major
};
template <>
struct alignas(64) BatchResult<Singles> {
  using Scalar = float;
  double energy[kElementBatch];
  BatchForces forces;
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
    point[n] = gather(positions, batch.node[n] + first);
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
  for (std::size_t n = 0; n < 3; ++n) store_force(n + 1, force[n], first, result.forces);
  store_force(0, -(force[0] + force[1] + force[2]), first, result.forces);
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

// Adds the forces of a batch: node by node, and element by element, as the blocks below.
SOFTHAND_INLINE void scatter_forces(const ElementBatch& batch, const BatchForces& forces, double* gradient) {
  for (std::size_t n = 0; n < 4; ++n) {
    for (std::size_t first = 0; first < batch.count; first += kVectorWidth) {
#pragma GCC unroll 8
      for (std::size_t i = 0; i < kVectorWidth; ++i) {
        const std::size_t lane = first + i;
        if (lane >= batch.count) break;
        double* stored = gradient + 3 * static_cast<std::ptrdiff_t>(batch.node[n][lane]);
        store_pair(stored, load_pair(stored) + load_pair(forces.xy[n] + 2 * (first + pair_place(i))));
        stored[2] += forces.z[n][lane];
      }
    }
  }
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

// Asks for values that the next batch needs. The machine does not foresee them, because the arrays of a batch are
// short.
template <typename Value, std::size_t kCount>
SOFTHAND_INLINE void prefetch(const Value (&values)[kCount]) {
  constexpr std::size_t kLine = 64;
#pragma GCC unroll 32
  for (std::size_t byte = 0; byte < sizeof(values); byte += kLine)
    __builtin_prefetch(reinterpret_cast<const char*>(values) + byte);
}

template <bool kGradient, bool kHessian>
struct Outputs {
  static constexpr bool gradient = kGradient, hessian = kHessian;
};

template <typename Row, bool kGradient, bool kHessian, typename Batch, typename Prefetch, typename Evaluate>
double evaluate_as(const Batch* batches, std::size_t count, const ElementOutput& output,
                   const Prefetch& prefetch_values, const Evaluate& evaluate) {
  double energy = 0;
  BatchResult<Row> result;
  for (const Batch* batch = batches; batch != batches + count; ++batch) {
    if (batch + 1 != batches + count) {
      prefetch(batch[1].shape);
      prefetch(batch[1].node);
      prefetch_values(batch[1]);
    }
    // The first bound tells the compiler that one round is enough if the lanes hold a whole batch. Otherwise it loads
    // the values of a second round ahead and spills them.
    for (std::size_t first = 0; first < kElementBatch && first < batch->count; first += kLanes)
      evaluate(Outputs<kGradient, kHessian>{}, *batch, first, result);
    for (std::size_t lane = 0; lane < batch->count; ++lane) energy += result.energy[lane];
    if constexpr (kGradient) scatter_forces(*batch, result.forces, output.gradient);
    if constexpr (kHessian) scatter_blocks(*batch, result, output.blocks);
  }
  return energy;
}

// Calls evaluate(Outputs, batch, first, result) for the lanes from `first` on of each batch. Adds the result to the
// output, batch by batch. prefetch_values(batch) asks for what the evaluation needs besides shape and nodes. Returns
// the energy.
template <typename Batch, typename Prefetch, typename Evaluate>
double evaluate_batches(const Batch* batches, std::size_t count, const ElementOutput& output,
                        const Prefetch& prefetch_values, const Evaluate& evaluate) {
  if (output.blocks == nullptr) {
    return output.gradient != nullptr
               ? evaluate_as<Lanes, true, false>(batches, count, output, prefetch_values, evaluate)
               : evaluate_as<Lanes, false, false>(batches, count, output, prefetch_values, evaluate);
  }
  if (output.gradient == nullptr)
    return evaluate_as<Lanes, false, true>(batches, count, output, prefetch_values, evaluate);
  return output.single_blocks ? evaluate_as<Singles, true, true>(batches, count, output, prefetch_values, evaluate)
                              : evaluate_as<Lanes, true, true>(batches, count, output, prefetch_values, evaluate);
}

}  // namespace
}  // namespace softhand
