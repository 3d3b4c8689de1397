// The implicit wrench, in closed form, with which the world's copy of an object follows a hand's twin.
//
// The coupling is U'_crb of ES2725128A1 (eq. 18 between object and twin) with damping. It is evaluated at the END of
// the world's own step. Therefore it is stable for any stiffness, although the engine takes plain wrenches. Source of
// the scheme: docs/coupling-objects.md.
#pragma once

#include "math/types.hpp"

namespace softhand {

/// Cap of a coupling force, in addition to the object's weight, N. It is the load that a hand can bear.
inline constexpr double kOwnerForceCap = 100;

/// The world's copy at the start of the step.
struct Follower {
  double mass = 1;                        ///< kg
  Matrix3 inertia = Matrix3::Identity();  ///< kg m^2, world axes
  Pose pose;
  Twist velocity;
  Vector3 gravity = Vector3::Zero();  ///< m/s^2, added by the engine itself
};

/// The twin, already extrapolated to the end of the step.
struct Leader {
  Pose pose;
  Twist velocity;
  Wrench wrench;  ///< of the hand on the twin; with it the follower accelerates like the twin
};

/// Mode owner: spring kappa m / T^2, critically damped. For rotation the inertia replaces m. Capped at 100 N + m|g| and
/// 10 N m.
Wrench owner_wrench(const Follower& b, const Leader& a, double kappa, double step);

/// Mode symmetric: spring with `stiffness` (N/m) and `angular_stiffness` (N m/rad). The damping ratio is relative to
/// critical damping. The same caps apply.
Wrench symmetric_wrench(const Follower& b, const Leader& a, double stiffness, double angular_stiffness,
                        double damping_ratio, double step);

}  // namespace softhand
