// Coulomb friction as an incremental potential. Contact with the hand's nodes and with the world's planes both use it.
#pragma once

#include <algorithm>
#include <cmath>

#include "math/types.hpp"

namespace softhand {

/// A tangential spring of stiffness k_t (N/m) with a force bounded by B = mu f_n (N). Its energy as a function of the
/// stretch s (tangential, metres) is
///   U = 1/2 k_t |s|^2            while k_t |s| <= B   (sticking)
///   U = B |s| - B^2 / (2 k_t)    beyond               (sliding; its increase is the heat of the step)
/// The energy is convex with a continuous gradient. Both stiffnesses are positive semi-definite (ES2725128A1 eq. 33
/// with Coulomb's law as bound).
struct CoulombSpring {
  double stiffness = 0;  ///< k_t, >= 0
  double bound = 0;      ///< B, >= 0; constant within a step

  bool slides(double stretch) const { return stiffness * stretch > bound; }
  double energy(double stretch) const {
    if (!slides(stretch)) return 0.5 * stiffness * stretch * stretch;
    return bound * (stretch - 0.5 * bound / stiffness);
  }
  /// Returns the secant stiffness: force = secant * stretch.
  double secant(double stretch) const { return slides(stretch) ? bound / stretch : stiffness; }
  /// d force / d stretch for a stretch in the plane of the unit normal n. `as_sliding` selects the sliding branch even
  /// if the stretch just reaches the bound. Zero if the bound is zero.
  Matrix3 tangent(const Vector3& stretch, const Vector3& n, bool as_sliding = false) const {
    if (!(bound > 0)) return Matrix3::Zero();
    const double length = stretch.norm();
    Matrix3 across = Matrix3::Identity() - n * n.transpose();
    if (length > 0 && (as_sliding || slides(length))) {
      across -= stretch * stretch.transpose() / (length * length);
      return std::min(stiffness, bound / length) * across;
    }
    return stiffness * across;
  }
  /// Distance in metres that the anchor must slide so that Coulomb's law holds for the current `limit` = mu f_n.
  double slide(double stretch, double limit) const {
    return stiffness > 0 ? std::max(0.0, stretch - limit / stiffness) : stretch;
  }
};

/// k_c A min(mu, 1). The source's mu k_c A (eq. 33) would vanish for small mu and be too stiff for large mu.
inline double friction_stiffness(double contact_stiffness, double friction) {
  return contact_stiffness * std::min(friction, 1.0);
}

}  // namespace softhand
