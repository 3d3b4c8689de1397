// Singular values and polar rotation of 3x3 matrices. Deformation gradients may be inverted or collapsed.
#pragma once

#include "math/types.hpp"

namespace softhand {

/// F = U diag(s) V^T with *rotations* U and V (det +1, no reflections) and s[0] >= s[1] >= |s[2]| up to rounding. The
/// smallest singular value has the sign of det F (ES2725128A1 eq. 30 and its reference 9). The polar rotation is R = U
/// V^T with det R = +1.
struct RotationSvd {
  Matrix3 u = Matrix3::Identity();
  Vector3 singular_values = Vector3::Zero();
  Matrix3 v = Matrix3::Identity();

  Matrix3 rotation() const { return u * v.transpose(); }
};

/// One-sided Jacobi method. The residual |F - U S V^T| is about 1e-15 |F|. Small singular values have high relative
/// accuracy. Deterministic, does not allocate. Defined for every finite F, including the zero matrix and rank 1 (then U
/// is completed to a rotation). If F contains NaN, the result contains NaN.
RotationSvd rotation_svd(const Matrix3& f);

}  // namespace softhand
