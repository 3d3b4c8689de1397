// Parallel arithmetic: `Lanes` is a row of doubles with the operators of one double, applied lane by lane.
//
// The width of the machine vectors follows from the compiler flags of the including file, so every name here has
// internal linkage. Include this header only from kernels that are compiled once per instruction set
// (instruction_set.hpp), never from another header. There is no fused multiply-add (-ffp-contract=off), and division
// and square root are exact. So the result of a lane has the same bits for every width.
#pragma once

#include <cstddef>
#include <cstdint>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

namespace softhand {
namespace {

#if defined(__AVX512F__)
constexpr std::size_t kVectorWidth = 8;  // doubles in a machine vector
#elif defined(__AVX2__)
constexpr std::size_t kVectorWidth = 4;
#else
constexpr std::size_t kVectorWidth = 2;
#endif
// Two independent vectors hide each other's latency, because an evaluation is one long chain of square roots and
// divisions.
constexpr std::size_t kVectorsPerLanes = 2;
constexpr std::size_t kLanes = kVectorWidth * kVectorsPerLanes;

typedef double Vector __attribute__((vector_size(8 * kVectorWidth)));
typedef std::int64_t VectorMask __attribute__((vector_size(8 * kVectorWidth)));
typedef double UnalignedVector __attribute__((vector_size(8 * kVectorWidth), aligned(8), may_alias));

#define SOFTHAND_INLINE [[gnu::always_inline]] inline

SOFTHAND_INLINE Vector load(const double* from) { return *reinterpret_cast<const UnalignedVector*>(from); }
SOFTHAND_INLINE void store(double* to, Vector value) { *reinterpret_cast<UnalignedVector*>(to) = value; }

SOFTHAND_INLINE Vector square_root(Vector x) {
#if defined(__AVX512F__)
  return _mm512_mask_sqrt_pd(x, 0xff, x);  // the unmasked form warns about its own uninitialised value in GCC 12
#elif defined(__AVX2__)
  return _mm256_sqrt_pd(x);
#elif defined(__x86_64__)
  return _mm_sqrt_pd(x);
#else
  for (std::size_t i = 0; i < kVectorWidth; ++i) x[i] = __builtin_sqrt(x[i]);
  return x;
#endif
}

SOFTHAND_INLINE bool any(VectorMask mask) {
#if defined(__AVX512F__)
  const auto bits = reinterpret_cast<__m512i>(mask);
  return _mm512_test_epi64_mask(bits, bits) != 0;
#elif defined(__AVX2__)
  return _mm256_movemask_epi8(reinterpret_cast<__m256i>(mask)) != 0;
#elif defined(__x86_64__)
  return _mm_movemask_epi8(reinterpret_cast<__m128i>(mask)) != 0;
#else
  std::int64_t all = 0;
  for (std::size_t i = 0; i < kVectorWidth; ++i) all |= mask[i];
  return all != 0;
#endif
}

/// Transposes the square matrix of `kVectorWidth` vectors. In each stage, the halves of pairs of rows swap places,
/// first single entries and at last half vectors.
SOFTHAND_INLINE void transpose(Vector (&row)[kVectorWidth]) {
#if defined(__AVX512F__)
  const VectorMask low[3] = {{0, 8, 2, 10, 4, 12, 6, 14}, {0, 1, 8, 9, 4, 5, 12, 13}, {0, 1, 2, 3, 8, 9, 10, 11}};
  const VectorMask high[3] = {{1, 9, 3, 11, 5, 13, 7, 15}, {2, 3, 10, 11, 6, 7, 14, 15}, {4, 5, 6, 7, 12, 13, 14, 15}};
  constexpr std::size_t stages = 3;
#elif defined(__AVX2__)
  const VectorMask low[2] = {{0, 4, 2, 6}, {0, 1, 4, 5}};
  const VectorMask high[2] = {{1, 5, 3, 7}, {2, 3, 6, 7}};
  constexpr std::size_t stages = 2;
#else
  const VectorMask low[1] = {{0, 2}};
  const VectorMask high[1] = {{1, 3}};
  constexpr std::size_t stages = 1;
#endif
#pragma GCC unroll 3
  for (std::size_t stage = 0; stage < stages; ++stage) {
    const std::size_t half = std::size_t{1} << stage;
#pragma GCC unroll 8
    for (std::size_t i = 0; i < kVectorWidth; ++i) {
      if ((i & half) != 0) continue;
      const Vector upper = row[i];
      const Vector lower = row[i + half];
      row[i] = __builtin_shuffle(upper, lower, low[stage]);
      row[i + half] = __builtin_shuffle(upper, lower, high[stage]);
    }
  }
}

struct Lanes {
  Vector part[kVectorsPerLanes];
};

/// A boolean per lane.
struct Choice {
  VectorMask part[kVectorsPerLanes];
};

// Applies one expression to each part.
#define SOFTHAND_EACH(Result, expression)                                                                   \
  Result result;                                                                                            \
  _Pragma("GCC unroll 4") for (std::size_t k = 0; k < kVectorsPerLanes; ++k) result.part[k] = (expression); \
  return result;

SOFTHAND_INLINE Lanes splat(double x){SOFTHAND_EACH(Lanes, x - Vector{})} SOFTHAND_INLINE Lanes
    load_lanes(const double* from){SOFTHAND_EACH(Lanes, load(from + k * kVectorWidth))} SOFTHAND_INLINE
    void store(double* to, const Lanes& x) {
  for (std::size_t k = 0; k < kVectorsPerLanes; ++k) store(to + k * kVectorWidth, x.part[k]);
}
SOFTHAND_INLINE Lanes operator+(const Lanes& a,
                                const Lanes& b){SOFTHAND_EACH(Lanes, a.part[k] + b.part[k])} SOFTHAND_INLINE Lanes
operator-(const Lanes& a, const Lanes& b){SOFTHAND_EACH(Lanes, a.part[k] - b.part[k])} SOFTHAND_INLINE Lanes
operator*(const Lanes& a, const Lanes& b){SOFTHAND_EACH(Lanes, a.part[k] * b.part[k])} SOFTHAND_INLINE Lanes
operator/(const Lanes& a, const Lanes& b){SOFTHAND_EACH(Lanes, a.part[k] / b.part[k])} SOFTHAND_INLINE Lanes
operator-(const Lanes& a){SOFTHAND_EACH(Lanes, -a.part[k])} SOFTHAND_INLINE Lanes
operator*(double a, const Lanes& b){SOFTHAND_EACH(Lanes, a* b.part[k])} SOFTHAND_INLINE Lanes
operator-(const Lanes& a, double b){SOFTHAND_EACH(Lanes, a.part[k] - b)} SOFTHAND_INLINE Choice
operator>(const Lanes& a, const Lanes& b){SOFTHAND_EACH(Choice, a.part[k] > b.part[k])} SOFTHAND_INLINE Choice
operator>(const Lanes& a, double b){SOFTHAND_EACH(Choice, a.part[k] > b)} SOFTHAND_INLINE Choice
operator<(const Lanes& a, double b){SOFTHAND_EACH(Choice, a.part[k] < b)} SOFTHAND_INLINE Choice
operator&(const Choice& a, const Choice& b){SOFTHAND_EACH(Choice, a.part[k] & b.part[k])} SOFTHAND_INLINE Choice
operator|(const Choice& a, const Choice& b){SOFTHAND_EACH(Choice, a.part[k] | b.part[k])} SOFTHAND_INLINE Choice
operator!(const Choice& a){SOFTHAND_EACH(Choice, ~a.part[k])} SOFTHAND_INLINE Lanes
    select(const Choice& choice, const Lanes& yes,
           const Lanes& no){SOFTHAND_EACH(Lanes, choice.part[k] ? yes.part[k] : no.part[k])} SOFTHAND_INLINE Lanes
    square_root(const Lanes& a){SOFTHAND_EACH(Lanes, square_root(a.part[k]))} SOFTHAND_INLINE Lanes
    absolute(const Lanes& a){
        SOFTHAND_EACH(Lanes, reinterpret_cast<Vector>(reinterpret_cast<VectorMask>(a.part[k]) & INT64_MAX))}
/// If one operand is NaN, the result is `b`.
SOFTHAND_INLINE Lanes maximum(const Lanes& a, const Lanes& b) {
  return select(a > b, a, b);
}
SOFTHAND_INLINE bool any(const Choice& choice) {
  VectorMask all = choice.part[0];
  for (std::size_t k = 1; k < kVectorsPerLanes; ++k) all |= choice.part[k];
  return any(all);
}

/// A row of single-precision numbers in one machine vector, with as many lanes as `Lanes`.
typedef float Singles __attribute__((vector_size(4 * kLanes)));
typedef float UnalignedSingles __attribute__((vector_size(4 * kLanes), aligned(4), may_alias));
typedef float SinglesPart __attribute__((vector_size(4 * kVectorWidth)));
typedef float UnalignedSinglesPart __attribute__((vector_size(4 * kVectorWidth), aligned(4), may_alias));

typedef std::int32_t SinglesMask __attribute__((vector_size(4 * kLanes)));

SOFTHAND_INLINE Singles select(SinglesMask choice, Singles yes, Singles no) { return choice ? yes : no; }
SOFTHAND_INLINE Singles absolute(Singles a) {
  return reinterpret_cast<Singles>(reinterpret_cast<SinglesMask>(a) & INT32_MAX);
}
/// If one operand is NaN, the result is `b`.
SOFTHAND_INLINE Singles maximum(Singles a, Singles b) { return a > b ? a : b; }
SOFTHAND_INLINE Singles square_root(Singles x) {
#if defined(__AVX512F__)
  return _mm512_mask_sqrt_ps(x, 0xffff, x);
#elif defined(__AVX2__)
  return _mm256_sqrt_ps(x);
#elif defined(__x86_64__)
  return _mm_sqrt_ps(x);
#else
  for (std::size_t i = 0; i < kLanes; ++i) x[i] = __builtin_sqrtf(x[i]);
  return x;
#endif
}
SOFTHAND_INLINE bool any(SinglesMask mask) { return any(reinterpret_cast<VectorMask>(mask)); }
SOFTHAND_INLINE void store(float* to, Singles value) { *reinterpret_cast<UnalignedSingles*>(to) = value; }
/// Loads `kVectorWidth` floats and converts them to doubles.
SOFTHAND_INLINE Vector load(const float* from) {
  return __builtin_convertvector(SinglesPart(*reinterpret_cast<const UnalignedSinglesPart*>(from)), Vector);
}

/// Converts to the type `Row` and rounds if `Row` has less precision.
template <typename Row>
SOFTHAND_INLINE Row rounded(const Lanes& a);
template <>
SOFTHAND_INLINE Lanes rounded<Lanes>(const Lanes& a) {
  return a;
}
template <>
SOFTHAND_INLINE Singles rounded<Singles>(const Lanes& a) {
  static_assert(kVectorsPerLanes == 2);
  const SinglesPart low = __builtin_convertvector(a.part[0], SinglesPart),
                    high = __builtin_convertvector(a.part[1], SinglesPart);
#if defined(__AVX512F__)
  return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
#elif defined(__AVX2__)
  return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7);
#else
  return __builtin_shufflevector(low, high, 0, 1, 2, 3);
#endif
}

/// Three rows that form points or directions.
template <typename Row>
struct Row3 {
  Row x, y, z;
};
using Lanes3 = Row3<Lanes>;

template <typename Row>
SOFTHAND_INLINE Row3<Row> operator+(const Row3<Row>& a, const Row3<Row>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <typename Row>
SOFTHAND_INLINE Row3<Row> operator-(const Row3<Row>& a, const Row3<Row>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <typename Row>
SOFTHAND_INLINE Row3<Row> operator-(const Row3<Row>& a) {
  return {-a.x, -a.y, -a.z};
}
template <typename Row>
SOFTHAND_INLINE Row3<Row> operator*(const Row& a, const Row3<Row>& b) {
  return {a * b.x, a * b.y, a * b.z};
}
template <typename Row>
SOFTHAND_INLINE Row dot(const Row3<Row>& a, const Row3<Row>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
SOFTHAND_INLINE Lanes3 cross(const Lanes3& a, const Lanes3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
SOFTHAND_INLINE Lanes3 select(const Choice& choice, const Lanes3& yes, const Lanes3& no) {
  return {select(choice, yes.x, no.x), select(choice, yes.y, no.y), select(choice, yes.z, no.z)};
}
template <typename Row>
SOFTHAND_INLINE Row3<Row> rounded(const Lanes3& a) {
  return {rounded<Row>(a.x), rounded<Row>(a.y), rounded<Row>(a.z)};
}

#undef SOFTHAND_EACH

}  // namespace
}  // namespace softhand
