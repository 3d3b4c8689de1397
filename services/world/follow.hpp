// The closed-form implicit wrench by which the world's copy of an object follows a hand's twin.
//
// The coupling is U'_crb of ES2725128A1 (eq. 18 between object and twin) with damping, taken at the END of the world's
// own step, so that it is stable for any stiffness although the engine takes plain wrenches. Source of the scheme:
// docs/coupling-objects.md.
#pragma once

#include "math/types.hpp"

namespace softhand {

/// Coupling forces end here, beyond the object's weight (what a hand bears), N.
inline constexpr double kOwnerForceCap = 100;

/// The world's copy at the start of the step.
struct Follower {
  double mass = 1;                        ///< kg
  Matrix3 inertia = Matrix3::Identity();  ///< kg m^2, world axes
  Pose pose;
  Twist velocity;
  Vector3 gravity = Vector3::Zero();  ///< m/s^2 that the engine adds by itself
};

/// The twin, already extrapolated to the end of the step.
struct Leader {
  Pose pose;
  Twist velocity;
  Wrench wrench;  ///< of the hand on the twin: what the follower needs to accelerate as the twin does
};

/// Mode owner: spring kappa m / T^2, critically damped; inertia takes the place of m in rotation. Capped at 100 N +
/// m|g| and 10 N m.
Wrench owner_wrench(const Follower& b, const Leader& a, double kappa, double step);

/// Mode symmetric: spring `stiffness` (N/m), `angular_stiffness` (N m/rad), damping over critical. The same caps.
Wrench symmetric_wrench(const Follower& b, const Leader& a, double stiffness, double angular_stiffness,
                        double damping_ratio, double step);

}  // namespace softhand
