// Rotations on SO(3): exponential, logarithm and derivatives for the energies. All are finite at 0 and at pi.
#pragma once

#include "math/types.hpp"

namespace softhand {

/// The skew matrix [v]x with [v]x u = v x u.
Matrix3 skew(const Vector3& v);

/// Rotation by |v| radians about v.
Quaternion rotation_exp(const Vector3& v);

/// Rotation vector of the shortest arc, |result| <= pi. q and -q give the same result. At exactly pi, the sign of the
/// axis makes its largest component positive.
Vector3 rotation_log(const Quaternion& q);

/// Inverse of the left Jacobian: log(exp(d) exp(v)) = v + left_jacobian_inverse(v) d + O(d^2). Finite for |v| <= pi
/// (singular only at 2 pi). The inverse of the right Jacobian is its transpose.
Matrix3 left_jacobian_inverse(const Vector3& v);
/// left_jacobian_inverse(v)^T y, computed without the matrix.
Vector3 left_jacobian_inverse_transpose(const Vector3& v, const Vector3& y);

/// Second derivative of the logarithm, contracted: the symmetric H with
/// y . log(exp(d) exp(v)) = y . v + y . J d + 1/2 d . H d + O(d^3), J = left_jacobian_inverse(v).
Matrix3 log_second_derivative(const Vector3& v, const Vector3& y);

/// Second derivative of the rotated arm, contracted: the symmetric H with
/// y . exp(d) arm = y . arm + y . (d x arm) + 1/2 d . H d + O(d^3).
Matrix3 rotated_arm_second_derivative(const Vector3& arm, const Vector3& y);

/// Pose moved by a spatial increment: position + translation, exp(rotation) * orientation (renormalised).
Pose increment(const Pose& pose, const Vector3& translation, const Vector3& rotation);
/// Pose of a body at `pose` after `seconds` with constant velocity. A body with zero velocity keeps its pose to the
/// bit.
Pose advanced(const Pose& pose, const Twist& velocity, double seconds);

}  // namespace softhand
