// The law of the tissue in the lanes of kernels (tissue_kernel.hpp, relaxation_kernel.hpp): the polar decomposition of
// F, energy and stress. Everything has internal linkage (element_lanes.hpp).
#pragma once

#include "energies/element_lanes.hpp"
#include "energies/tissue_kernel.hpp"

namespace softhand {
namespace {

constexpr int kMaxSweeps = 12;         // one-sided Jacobi converges quadratically; usually 3 to 5 sweeps
constexpr double kOrthogonal = 1e-29;  // squared cosine
// Below this, squares lose digits and the columns have no reliable direction.
constexpr double kSmallestProduct = 1e-280;
// A unit column without its part along the longest column has no reliable direction if it is shorter than this.
constexpr double kNoDirection = 0.1;
constexpr double kSmallestScale = 1e-300;  // a smaller matrix counts as zero
constexpr int kMaxPolarIterations = 7;     // of Newton: a stretch of 2 takes 5, a stretch of 5 or 1/5 takes 7
// Newton iterations before the first check of the change. With the next one, they suffice for strains up to 0.14.
constexpr int kUsualPolarIterations = 3;
// Smallest accepted det^2 / |F|^6 (Frobenius norm). The ratio is 1/27 if all stretches are equal.
constexpr double kFlat = 1e-6;
constexpr double kPolarChange = 1e-16;  // squared change of the last iteration; the remaining error is half of it

// F = sum_k s_k u_k v_k^T as in math/polar.hpp: U and V are rotations, s descends, and the last s has the sign of det
// F. s itself is not stored.
struct LaneSvd {
  Lanes3 u[3], v[3];
};

// Rotates a_p and a_q (and v_p, v_q with them) until they are orthogonal. Lanes in which they are orthogonal do not
// change.
SOFTHAND_INLINE void orthogonalise(Lanes3& a_p, Lanes3& a_q, Lanes3& v_p, Lanes3& v_q) {
  const Lanes pp = dot(a_p, a_p);
  const Lanes qq = dot(a_q, a_q);
  const Lanes pq = dot(a_p, a_q);
  const Lanes square = pq * pq;
  const Choice turns = (square > kOrthogonal * (pp * qq)) & (square > kSmallestProduct);
  const Lanes difference = 0.5 * (qq - pp);
  const Lanes adjacent = absolute(difference) + square_root(difference * difference + square);
  const Lanes inverse = splat(1.0) / square_root(adjacent * adjacent + square);
  const Lanes c = select(turns, adjacent * inverse, splat(1.0));
  const Lanes s = select(turns, select(difference < 0.0, -pq, pq) * inverse, splat(0.0));
  const Lanes3 x = a_p;
  a_p = c * x - s * a_q;
  a_q = s * x + c * a_q;
  const Lanes3 y = v_p;
  v_p = c * y - s * v_q;
  v_q = s * y + c * v_q;
}

SOFTHAND_INLINE Choice skewed(const Lanes3& a, const Lanes3& b) {
  const Lanes product = dot(a, b);
  const Lanes square = product * product;
  return (square > kOrthogonal * (dot(a, a) * dot(b, b))) & (square > kSmallestProduct);
}

// A unit vector orthogonal to the unit vector `u` (Duff et al. 2017).
SOFTHAND_INLINE Lanes3 perpendicular(const Lanes3& u) {
  const Lanes sign = select(u.z < 0.0, splat(-1.0), splat(1.0));
  const Lanes a = splat(-1.0) / (sign + u.z);
  return {splat(1.0) + sign * u.x * u.x * a, sign * (u.x * u.y * a), -(sign * u.x)};
}

SOFTHAND_INLINE LaneSvd lane_svd(const Lanes3 (&f)[3]) {
  // Scaled, so that squares do not overflow or underflow.
  Lanes scale = absolute(f[0].x);
#pragma GCC unroll 3
  for (std::size_t j = 0; j < 3; ++j)
    scale = maximum(absolute(f[j].x), maximum(absolute(f[j].y), maximum(absolute(f[j].z), scale)));
  const Choice vanishes = scale < kSmallestScale;
  const Lanes inverse = splat(1.0) / select(vanishes, splat(1.0), scale);
  const Lanes one = splat(1.0), zero = splat(0.0);
  Lanes3 a[3];
  Lanes3 v[3] = {{one, zero, zero}, {zero, one, zero}, {zero, zero, one}};
#pragma GCC unroll 3
  for (std::size_t j = 0; j < 3; ++j) a[j] = select(vanishes, v[j], inverse * f[j]);
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    // Converged lanes do not change any more, so their result does not depend on the number of sweeps.
    if (!any(skewed(a[0], a[1]) | skewed(a[0], a[2]) | skewed(a[1], a[2]))) break;
    orthogonalise(a[0], a[1], v[0], v[1]);
    orthogonalise(a[0], a[2], v[0], v[2]);
    orthogonalise(a[1], a[2], v[1], v[2]);
  }
  Lanes square[3] = {dot(a[0], a[0]), dot(a[1], a[1]), dot(a[2], a[2])};
  const auto order = [&](std::size_t p, std::size_t q) {
    const Choice swaps = square[q] > square[p];
    const Lanes larger = select(swaps, square[q], square[p]);
    square[q] = select(swaps, square[p], square[q]);
    square[p] = larger;
    // One of the two changes its sign, so that V stays a rotation.
    const auto swap = [&swaps](Lanes3& x, Lanes3& y) {
      const Lanes3 first = select(swaps, y, x);
      y = select(swaps, -x, y);
      x = first;
    };
    swap(a[p], a[q]);
    swap(v[p], v[q]);
  };
  order(0, 1);
  order(0, 2);
  order(1, 2);
  LaneSvd svd;
  svd.u[0] = (one / square_root(square[0])) * a[0];
  // A short column is orthogonal to the long column only up to the rounding error of the long column.
  svd.u[1] = (one / square_root(square[1])) * a[1];
  svd.u[1] = svd.u[1] - dot(svd.u[0], svd.u[1]) * svd.u[0];
  const Lanes length = square_root(dot(svd.u[1], svd.u[1]));
  const Choice directed = length > kNoDirection;
  svd.u[1] = (one / length) * svd.u[1];
  if (any(!directed)) svd.u[1] = select(directed, svd.u[1], perpendicular(svd.u[0]));
  svd.u[2] = cross(svd.u[0], svd.u[1]);
#pragma GCC unroll 3
  for (std::size_t k = 0; k < 3; ++k) svd.v[k] = v[k];
  return svd;
}

// Computes R of F = R S by Newton's iteration X <- (X + X^-T) / 2 from F (Higham 1986). It needs no square roots and no
// directions; energy and gradient need no directions either. Returns the lanes in which it converged. It does not
// converge for elements that are pressed flat (their cofactors are rounding errors) or inverted.
SOFTHAND_INLINE Choice lane_polar(const Lanes3 (&f)[3], Lanes3 (&r)[3]) {
  const Lanes volume = dot(f[0], cross(f[1], f[2])), square = dot(f[0], f[0]) + dot(f[1], f[1]) + dot(f[2], f[2]);
  const Choice upright = (volume > 0.0) & (volume * volume > kFlat * square * square * square);
#pragma GCC unroll 3
  for (std::size_t j = 0; j < 3; ++j) r[j] = f[j];
  Lanes3 change[3];
  const auto iterate = [&r, &change ]() __attribute__((always_inline)) {
    const Lanes3 cofactor[3] = {cross(r[1], r[2]), cross(r[2], r[0]), cross(r[0], r[1])};
    const Lanes half = splat(0.5) / dot(r[0], cofactor[0]);
#pragma GCC unroll 3
    for (std::size_t j = 0; j < 3; ++j) change[j] = half * cofactor[j] - splat(0.5) * r[j];
  };
#pragma GCC unroll 3
  for (int iteration = 0; iteration < kUsualPolarIterations; ++iteration) {
    iterate();
#pragma GCC unroll 3
    for (std::size_t j = 0; j < 3; ++j) r[j] = r[j] + change[j];
  }
  // Converged lanes do not change any more, so their result does not depend on the number of iterations.
  Choice done = splat(0.0) > 0.0;
  for (int iteration = kUsualPolarIterations; iteration < kMaxPolarIterations; ++iteration) {
    iterate();
#pragma GCC unroll 3
    for (std::size_t j = 0; j < 3; ++j) r[j] = select(done, r[j], r[j] + change[j]);
    done = done | (dot(change[0], change[0]) + dot(change[1], change[1]) + dot(change[2], change[2]) < kPolarChange);
    if (!any(upright & !done)) break;
  }
  return upright & done;
}

// Squared relative threshold below which an off-diagonal stretch entry counts as zero.
template <typename Row>
constexpr double kDiagonal = 1e-30;
template <>
constexpr double kDiagonal<Singles> = 1e-13;
// Absolute floor of this threshold. Smaller squares lose digits, and rotations by them change the length of the axes.
template <typename Row>
constexpr double kSmallestSquare = kSmallestProduct;
template <>
constexpr double kSmallestSquare<Singles> = 1e-30;

// Rotates the symmetric matrix until its entry between p and q is zero, and rotates v_p and v_q with it. `diagonal` and
// `beside` are the entries of the matrix. An entry beside the diagonal has the index of the axis that is not involved.
// A square below `least` counts as zero.
template <typename Row>
SOFTHAND_INLINE void diagonalise(Row (&diagonal)[3], Row (&beside)[3], Row3<Row> (&v)[3], std::size_t p, std::size_t q,
                                 const Row& least) {
  const Row one = rounded<Row>(splat(1.0)), zero = one - one, half = rounded<Row>(splat(0.5));
  const Row pq = beside[3 - p - q];
  const Row square = pq * pq;
  const auto turns = square > least;
  const Row middle = half * (diagonal[p] + diagonal[q]), difference = half * (diagonal[q] - diagonal[p]);
  const auto falls = zero > difference;
  const Row distance = square_root(difference * difference + square);
  const Row adjacent = absolute(difference) + distance;
  const Row inverse = one / square_root(adjacent * adjacent + square);
  const Row c = select(turns, adjacent * inverse, one);
  const Row s = select(turns, select(falls, -pq, pq) * inverse, zero);
  const Row along = select(falls, -distance, distance);
  diagonal[p] = select(turns, middle - along, diagonal[p]);
  diagonal[q] = select(turns, middle + along, diagonal[q]);
  beside[3 - p - q] = select(turns, zero, pq);
  const Row pr = beside[q], qr = beside[p];
  beside[q] = c * pr - s * qr;
  beside[p] = s * pr + c * qr;
  const Row3<Row> x = v[p];
  v[p] = c * x - s * v[q];
  v[q] = s * x + c * v[q];
}

// Eigenvectors of a symmetric matrix, in any order, by Jacobi's method. `diagonal` and `beside` as in `diagonalise`. At
// the end, `diagonal` has the eigenvalues.
template <typename Row>
SOFTHAND_INLINE void lane_axes(Row (&diagonal)[3], Row (&beside)[3], Row3<Row> (&v)[3]) {
  const Row one = rounded<Row>(splat(1.0)), zero = one - one;
  Row least = zero;
#pragma GCC unroll 3
  for (std::size_t j = 0; j < 3; ++j) {
    least = least + diagonal[j] * diagonal[j];
    v[j] = {j == 0 ? one : zero, j == 1 ? one : zero, j == 2 ? one : zero};
  }
  least = rounded<Row>(splat(kDiagonal<Row>)) * least + rounded<Row>(splat(kSmallestSquare<Row>));
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    // Converged lanes do not change any more, so their result does not depend on the number of sweeps.
    if (!any((beside[0] * beside[0] > least) | (beside[1] * beside[1] > least) | (beside[2] * beside[2] > least)))
      break;
    diagonalise(diagonal, beside, v, 0, 1, least);
    diagonalise(diagonal, beside, v, 0, 2, least);
    diagonalise(diagonal, beside, v, 1, 2, least);
  }
}

// The law at the deformation gradients of a row of elements: its stress and what the stiffness needs
// (corotational.hpp).
struct LaneLaw {
  Lanes3 rotation[3], strain[3];  // R, F - R
  Lanes trace, quadratic;         // sum of the principal strains; W_q
  Lanes along, along_square;      // way along the ramp of strain limiting, from 0 to 2 w; its square over 2 w
  Lanes beyond;                   // way beyond the ramp
  Lanes mu, lambda, limit_energy, limit_stiffness, ramp, ramp_rate;

  SOFTHAND_INLINE Lanes density() const {
    return quadratic + limit_stiffness * ((1.0 / 6) * along * along_square + beyond * (ramp + 0.5 * beyond));
  }
  SOFTHAND_INLINE Lanes slope() const { return limit_stiffness / limit_energy; }
  SOFTHAND_INLINE Lanes factor() const { return splat(1.0) + slope() * (0.5 * along_square + beyond); }
};

SOFTHAND_INLINE LaneLaw lane_law(const TissueBatch& batch, std::size_t first, const Lanes3 (&f)[3]) {
  const auto row = [first](const double(&values)[kElementBatch]) { return load_lanes(values + first); };
  LaneLaw law;
  law.mu = row(batch.mu), law.lambda = row(batch.lambda);
  law.limit_energy = row(batch.limit_energy), law.limit_stiffness = row(batch.limit_stiffness);
  const Choice rotated = lane_polar(f, law.rotation);
  if (any(!rotated)) {
    const LaneSvd svd = lane_svd(f);
    const auto row_of = [](const Lanes3& v, std::size_t j) { return j == 0 ? v.x : j == 1 ? v.y : v.z; };
#pragma GCC unroll 3
    for (std::size_t j = 0; j < 3; ++j) {
      law.rotation[j] =
          select(rotated, law.rotation[j],
                 row_of(svd.v[0], j) * svd.u[0] + row_of(svd.v[1], j) * svd.u[1] + row_of(svd.v[2], j) * svd.u[2]);
    }
  }
#pragma GCC unroll 3
  for (std::size_t j = 0; j < 3; ++j) law.strain[j] = f[j] - law.rotation[j];
  const auto product = [](const Lanes3(&a)[3], const Lanes3(&b)[3]) {
    return dot(a[0], b[0]) + dot(a[1], b[1]) + dot(a[2], b[2]);
  };
  law.trace = product(law.rotation, law.strain);
  law.quadratic = law.mu * product(law.strain, law.strain) + 0.5 * law.lambda * law.trace * law.trace;
  const Lanes excess = law.quadratic / law.limit_energy - 1.0;
  law.ramp = row(batch.limit_ramp), law.ramp_rate = row(batch.ramp_rate);
  law.beyond = maximum(excess - law.ramp, splat(0.0));
  law.along = maximum(excess + law.ramp, splat(0.0)) - law.beyond;
  law.along_square = law.ramp_rate * law.along * law.along;
  return law;
}

SOFTHAND_INLINE void prefetch_values(const TissueBatch& next) {
  prefetch(next.volume);
  prefetch(next.mu);
  prefetch(next.lambda);
  prefetch(next.limit_energy);
  prefetch(next.limit_stiffness);
  prefetch(next.limit_ramp);
  prefetch(next.ramp_rate);
}

}  // namespace
}  // namespace softhand
