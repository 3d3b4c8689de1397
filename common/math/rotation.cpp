#include "math/rotation.hpp"

#include <cmath>

namespace softhand {
namespace {

// c(t) of J_l^-1(v) = I - [v]/2 + c [v]^2, c = (1 - (t/2) cot(t/2)) / t^2, and c'(t)/t. Below 0.05 rad the closed forms
// lose digits by cancellation, so series are used.
struct InverseJacobianCoefficients {
  double c;
  double c_prime_over_t;
};

InverseJacobianCoefficients inverse_jacobian_coefficients(double t) {
  const double t2 = t * t;
  if (t < 0.05) {
    // (t/2) cot(t/2) = 1 - t^2/12 - t^4/720 - t^6/30240 - t^8/1209600 - ...
    return {1.0 / 12.0 + t2 / 720.0 + t2 * t2 / 30240.0 + t2 * t2 * t2 / 1209600.0,
            1.0 / 360.0 + t2 / 7560.0 + t2 * t2 / 201600.0};
  }
  const double s = std::sin(0.5 * t);
  const double half_cot = 0.5 * t * std::cos(0.5 * t) / s;
  const double c = (1.0 - half_cot) / t2;
  // d/dt [(t/2) cot(t/2)] = cot(t/2)/2 - t / (4 sin^2(t/2))
  const double derivative = half_cot / t - 0.25 * t / (s * s);
  return {c, (-derivative / t2 - 2.0 * c / t) / t};
}

}  // namespace

Matrix3 skew(const Vector3& v) {
  Matrix3 m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Quaternion rotation_exp(const Vector3& v) {
  const double t2 = v.squaredNorm();
  const double t = std::sqrt(t2);
  const double k = t < 1e-4 ? 0.5 - t2 / 48.0 : std::sin(0.5 * t) / t;
  return Quaternion(std::cos(0.5 * t), k * v.x(), k * v.y(), k * v.z());
}

Vector3 rotation_log(const Quaternion& q) {
  Vector3 axis = q.vec();
  double w = q.w();
  if (w < 0) {
    w = -w;
    axis = -axis;
  }
  const double s2 = axis.squaredNorm();
  if (w == 0) {
    Eigen::Index largest = 0;
    axis.cwiseAbs().maxCoeff(&largest);
    if (axis[largest] < 0) axis = -axis;
  }
  const double s = std::sqrt(s2);
  // Below 0.02 rad (a typical rotation within a millisecond), the series of atan(x)/x is exact to rounding.
  const double x2 = s2 / (w * w);
  const double k =
      s < 0.01 ? 2.0 / w * (1.0 - x2 * (1.0 / 3.0 - x2 * (1.0 / 5.0 - x2 / 7.0))) : 2.0 * std::atan2(s, w) / s;
  return k * axis;
}

Matrix3 left_jacobian_inverse(const Vector3& v) {
  const Matrix3 k = skew(v);
  return Matrix3::Identity() - 0.5 * k + inverse_jacobian_coefficients(v.norm()).c * k * k;
}

Vector3 left_jacobian_inverse_transpose(const Vector3& v, const Vector3& y) {
  const Vector3 turned = v.cross(y);
  return y + 0.5 * turned + inverse_jacobian_coefficients(v.norm()).c * v.cross(turned);
}

Matrix3 log_second_derivative(const Vector3& v, const Vector3& y) {
  // With v(s) = log(exp(s d) exp(v)): v' = J(v) d, v'' = (dJ/dv [v']) d. For a direction e = J d, with [v]^2 = v v^T -
  // |v|^2 I: dJ[e] = -[e]/2 + (c'/t)(v . e) [v]^2 + c (e v^T + v e^T - 2 (v . e) I).
  const auto [c, c_prime_over_t] = inverse_jacobian_coefficients(v.norm());
  const Matrix3 j = left_jacobian_inverse(v);
  const Matrix3 v_squared = v * v.transpose() - v.squaredNorm() * Matrix3::Identity();
  // y . dJ[e] d as a bilinear form e^T B d.
  const Matrix3 b = -0.5 * skew(y).transpose() + c_prime_over_t * v * (v_squared * y).transpose() +
                    c * (y * v.transpose() + y.dot(v) * Matrix3::Identity() - 2.0 * v * y.transpose());
  const Matrix3 h = j.transpose() * b;
  return 0.5 * (h + h.transpose());
}

Matrix3 rotated_arm_second_derivative(const Vector3& arm, const Vector3& y) {
  // exp(d) arm = arm + d x arm + (d (d . arm) - arm |d|^2)/2 + O(d^3)
  const Matrix3 outer = y * arm.transpose();
  return 0.5 * (outer + outer.transpose()) - y.dot(arm) * Matrix3::Identity();
}

Pose increment(const Pose& pose, const Vector3& translation, const Vector3& rotation) {
  return {pose.position + translation, (rotation_exp(rotation) * pose.orientation).normalized()};
}

Pose advanced(const Pose& pose, const Twist& velocity, double seconds) {
  if (velocity.linear.isZero(0) && velocity.angular.isZero(0)) return pose;
  return increment(pose, seconds * velocity.linear, seconds * velocity.angular);
}

}  // namespace softhand
