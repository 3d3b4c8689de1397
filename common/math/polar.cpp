#include "math/polar.hpp"

#include <cmath>
#include <utility>

namespace softhand {
namespace {

// Rotates columns p and q of `a` (and of `v` with them) until they are orthogonal. Returns false if they already were.
bool orthogonalise(Matrix3& a, Matrix3& v, int p, int q) {
  const double pp = a.col(p).squaredNorm();
  const double qq = a.col(q).squaredNorm();
  const double pq = a.col(p).dot(a.col(q));
  constexpr double kOrthogonal = 1e-29;  // square of the cosine
  if (pq * pq <= kOrthogonal * pp * qq || pq == 0.0) return false;
  const double zeta = (qq - pp) / (2.0 * pq);
  const double t = std::copysign(1.0, zeta) / (std::abs(zeta) + std::sqrt(1.0 + zeta * zeta));
  const double c = 1.0 / std::sqrt(1.0 + t * t);
  const double s = c * t;
  for (Matrix3* m : {&a, &v}) {
    const Vector3 x = m->col(p);
    const Vector3 y = m->col(q);
    m->col(p) = c * x - s * y;
    m->col(q) = s * x + c * y;
  }
  return true;
}

// Any unit vector orthogonal to the unit vector `u`.
Vector3 perpendicular(const Vector3& u) {
  int smallest = 0;
  u.cwiseAbs().minCoeff(&smallest);
  return u.cross(Vector3::Unit(smallest)).normalized();
}

}  // namespace

RotationSvd rotation_svd(const Matrix3& f) {
  RotationSvd svd;
  const double scale = f.cwiseAbs().maxCoeff();
  if (scale == 0.0) return svd;
  if (!f.allFinite()) {
    svd.singular_values.setConstant(std::nan(""));
    svd.u.setConstant(std::nan(""));
    return svd;
  }
  // Scaled, so that squares do not overflow or underflow.
  Matrix3 a = f / scale;
  Matrix3 v = Matrix3::Identity();
  for (int sweep = 0; sweep < 12; ++sweep) {  // converges quadratically; usually 3 to 5 sweeps
    const bool first = orthogonalise(a, v, 0, 1);
    const bool second = orthogonalise(a, v, 0, 2);
    const bool third = orthogonalise(a, v, 1, 2);
    if (!first && !second && !third) break;
  }
  Vector3 squares = a.colwise().squaredNorm().transpose();
  const auto order = [&](int p, int q) {
    if (squares[p] >= squares[q]) return;
    std::swap(squares[p], squares[q]);
    a.col(p).swap(a.col(q));
    v.col(p).swap(v.col(q));
  };
  order(0, 1);
  order(0, 2);
  order(1, 2);
  if (v.determinant() < 0.0) {
    v.col(2) = -v.col(2);
    a.col(2) = -a.col(2);
  }
  svd.v = v;
  svd.u.col(0) = a.col(0) / std::sqrt(squares[0]);
  const double second = std::sqrt(squares[1]);
  // Below this length the column is only rounding error or zero and has no direction.
  constexpr double kNoDirection = 1e-150;
  if (second > kNoDirection) {
    Vector3 u1 = a.col(1) / second;
    u1 -= svd.u.col(0).dot(u1) * svd.u.col(0);
    const double length = u1.norm();
    svd.u.col(1) = length > 0.5 ? Vector3(u1 / length) : perpendicular(svd.u.col(0));
  } else {
    svd.u.col(1) = perpendicular(svd.u.col(0));
  }
  svd.u.col(2) = svd.u.col(0).cross(svd.u.col(1));
  svd.singular_values[0] = scale * svd.u.col(0).dot(a.col(0));
  svd.singular_values[1] = scale * svd.u.col(1).dot(a.col(1));
  svd.singular_values[2] = scale * svd.u.col(2).dot(a.col(2));
  return svd;
}

}  // namespace softhand
