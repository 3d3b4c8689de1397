// Singular values and polar rotation of 3x3 matrices, for deformation gradients that may be inverted or collapsed.
#pragma once

#include "math/types.hpp"

namespace softhand {

/// F = U diag(s) V^T with *rotations* U and V (det +1, no reflections) and s[0] >= s[1] >= |s[2]| up to rounding: the
/// smallest singular value carries the sign of det F (ES2725128A1 eq. 30 and its reference 9). The polar rotation is R
/// = U V^T, det R = +1.
struct RotationSvd {
  Matrix3 u = Matrix3::Identity();
  Vector3 singular_values = Vector3::Zero();
  Matrix3 v = Matrix3::Identity();

  Matrix3 rotation() const { return u * v.transpose(); }
};

/// One-sided Jacobi: residual |F - U S V^T| about 1e-15 |F|, small singular values to high relative accuracy.
/// Deterministic, allocates nothing, defined for every finite F, the zero matrix and rank 1 included (there U completes
/// itself to a rotation). Not-a-number in, not-a-number out.
RotationSvd rotation_svd(const Matrix3& f);

}  // namespace softhand
