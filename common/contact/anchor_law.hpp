// The law of one anchor: normal contact (ES2725128A1 eq. 32), friction (eq. 33) and the anchor's movement (figure 4).
// This file knows no shapes, no objects and no unknowns. energies/contact.hpp and energies/friction.hpp list the
// departures from the source.
//
//   U_n = 1/2 k_c A min(0, u)^2,   u = n . e,   e = R^T (x_p - x_b) - a
//   U_f = CoulombSpring(k_c A min(mu, 1), mu f_n)(|T e - s_0|),   T = 1 - n n^T
//
// Places and normals are in the frame of the object, (x_b, R), unless said otherwise. Units: J, m, N, N/m.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

#include "contact/coulomb.hpp"
#include "geometry/shape.hpp"
#include "math/types.hpp"

namespace softhand {

/// What an anchor carries from step to step.
struct AnchorMemory {
  std::int32_t point = 0;             ///< index into the table of contact points
  std::int32_t slot = 0;              ///< of the object
  std::int32_t sharp = -1;            ///< sharp point of the object at which the anchor is; -1: on the surface
  Vector3 weights = Vector3::Zero();  ///< of the corners of the point's triangle, if `sharp` >= 0
  Vector3 anchor = Vector3::Zero();   ///< a: the surface point, moved inwards by `recess`
  Vector3 normal = Vector3::UnitY();  ///< n
  double recess = 0;                ///< distance that the anchor of a point that started inside must still move out, m
  bool sliding = false;             ///< slid in the last step; within a step: and still moves in that direction
  bool missed = false;              ///< found at the end of the last step: its normal force is not known yet
  double normal_energy = 0;         ///< 1/2 k min(0, u)^2 at the end of the last step, J
  double friction_energy = 0;       ///< 1/2 k_t |s|^2 at the end of the last step, J; |s| is at most mu f_n / k_t
  Vector3 force = Vector3::Zero();  ///< on the point in the last step, N, world
  double slip_speed = 0;            ///< in the last step, m/s
};

/// One touching (or about to touch) contact point.
struct ContactAnchor : AnchorMemory {
  bool known = false;  ///< existed at the end of the last step
  // Given by the point and the object.
  double stiffness = 0;           ///< k_c A, N/m
  double friction = 0;            ///< mu
  double friction_stiffness = 0;  ///< k_c A min(mu, 1), N/m
  // Fixed within the step.
  bool fresh = false;           ///< began in this step, before the point reached the surface
  bool two_sided = false;       ///< predicted to cross in this step, and no iteration has moved the point yet
  bool ahead = false;           ///< anchor and normal are at the place to which the point slides
  double friction_bound = 0;    ///< mu f_n, N, with f_n from the step's start
  double predicted_secant = 0;  ///< secant of a fresh anchor's friction at the predicted end of the step, N/m
  Vector3 stretch_origin = Vector3::Zero();  ///< tangential stretch that exerts no force (fresh, ahead; else zero)
  Vector3 stretch_start = Vector3::Zero();   ///< tangential stretch at the step's start
  double start_energy = 0;                   ///< normal energy at the step's start, with the plane of this step, J
  double start_excess = 0;                   ///< excess of |s| over the stretch stored in `friction_energy`, m

  void set_friction(double mu) {
    friction = mu;
    friction_stiffness = softhand::friction_stiffness(stiffness, mu);
  }
};

/// e in world axes, with the values that its derivatives need.
struct AnchorOffset {
  Vector3 offset;    ///< R e
  Vector3 normal;    ///< R n
  Vector3 lever;     ///< x_p - x_b
  double depth = 0;  ///< u; negative: penetrating
  Vector3 stretch;   ///< R (T e - s_0), tangential
  double moved = 0;  ///< change of the stretch since the step's start, m
};

/// The places of a contact point that matter at the start of a step.
struct AnchorPath {
  Vector3 before;  ///< at the pose from which the object's motion counts
  Vector3 start;   ///< at the object's pose at the step's start
  Vector3 first;   ///< at the pose with which a minimiser starts
  Vector3 end;     ///< predicted, at the object's pose at the step's end
};

namespace anchor_law {

/// `object`: the pose that energies use. `position`: of the contact point, world.
inline AnchorOffset offset(const ContactAnchor& anchor, const Pose& object, const Vector3& position) {
  AnchorOffset result;
  result.lever = position - object.position;
  const Vector3 e = object.orientation.conjugate() * result.lever - anchor.anchor;
  result.depth = anchor.normal.dot(e);
  const Vector3 stretch = e - result.depth * anchor.normal - anchor.stretch_origin;
  result.moved = (stretch - anchor.stretch_start).norm();
  result.offset = object.orientation * e;
  result.normal = object.orientation * anchor.normal;
  result.stretch = object.orientation * stretch;
  return result;
}

inline CoulombSpring friction_of(const ContactAnchor& anchor) {
  return {anchor.friction_stiffness, anchor.friction_bound};
}
/// Whether U_n acts.
inline bool pushes(const ContactAnchor& anchor, double depth) { return anchor.two_sided || depth < 0; }
/// 1/2 k u^2: U_n while the contact pushes.
inline double energy(const ContactAnchor& anchor, double depth) { return 0.5 * anchor.stiffness * depth * depth; }
/// The stored normal energy. Unlike U_n it is one-sided even for a contact that is two-sided in its first iteration.
inline double stored_normal_energy(const ContactAnchor& anchor, double depth) {
  const double sunk = std::min(depth, 0.0);
  return 0.5 * anchor.stiffness * sunk * sunk;
}
/// Normal force on the point at the end of a step, N, world.
inline Vector3 push(const ContactAnchor& anchor, const AnchorOffset& o) {
  const double pressure = pushes(anchor, o.depth) ? -anchor.stiffness * o.depth : 0.0;
  return pressure * o.normal;
}
/// Friction force on the point at the end of a step, N, world.
inline Vector3 drag(const ContactAnchor& anchor, const AnchorOffset& o) {
  return -friction_of(anchor).secant(o.stretch.norm()) * o.stretch;
}

/// d drag / d stretch at `o`, N/m, world. `exact`: at the stretch itself. Otherwise the stiffness at the step's start
/// is a choice at the kink: an anchor that slid and moves on slides, and a fresh anchor has the secant to its predicted
/// stretch.
Matrix3 tangential_stiffness(const ContactAnchor& anchor, const AnchorOffset& o, bool exact);

/// Start of a step: the anchor of a point that started inside moves out.
void move_out(ContactAnchor& anchor, double time_step);
/// Normal force at a place in front of the anchor, N.
double pressure_at(const ContactAnchor& anchor, const Vector3& place);
/// The object moved the anchor's plane away from under the point: continue in the plane of `surface`, which is the
/// surface at the path's end. The stretch is the length of surface that passes the point.
void sweep(ContactAnchor& anchor, const AnchorPath& path, const SurfacePoint& surface);
/// Whether the anchor sticks while the surface under the point moves to `surface`. `limit`: mu f_n, N.
bool sticks(const ContactAnchor& anchor, const SurfacePoint& surface, double limit);

/// What `begin` returns.
struct Ahead {
  Vector3 now;       ///< the point relative to the anchor
  Vector3 stretch;   ///< tangential part of `now`
  Vector3 movement;  ///< predicted, tangential
};
/// Fixes the friction of the step. `pressure_before`: at the path's `before`, N. `swept`: `sweep` was called. `mass`:
/// of the point, kg.
Ahead begin(ContactAnchor& anchor, const AnchorPath& path, double pressure_before, bool swept, double mass,
            double time_step);
/// A sliding anchor needs the plane ahead, `surface`, at anchor + movement.
void move_ahead(ContactAnchor& anchor, Ahead& ahead, const SurfacePoint& surface);
/// Fixes the stretch and the energies at the step's start.
void finish_begin(ContactAnchor& anchor, const AnchorPath& path, const Ahead& ahead, double depth_before, bool swept);

/// The slide of an anchor at the end of a step.
struct Slide {
  double heat = 0;                     ///< J
  bool moves = false;                  ///< the anchor must move along the surface
  Vector3 movement = Vector3::Zero();  ///< of the anchor
};
/// A sliding anchor follows the point over the surface until |f_t| = mu |f_n|. A sticking anchor does not move. `drag`:
/// |f_t| of the step, N. Its work over the sliding distance is heat.
Slide slide(ContactAnchor& anchor, double drag, const Pose& object, const Vector3& position, double time_step);
/// The point on the surface that the anchor belongs to.
inline Vector3 surface_point(const ContactAnchor& anchor) { return anchor.anchor + anchor.recess * anchor.normal; }
/// Moves the anchor to a place on the surface.
void place(ContactAnchor& anchor, const SurfacePoint& surface);

/// The energies of the contact with the anchor and plane that it has between steps.
struct Stored {
  double normal = 0, friction = 0;  ///< J
};
Stored stored(const ContactAnchor& anchor, const AnchorOffset& offset);
/// Whether the contact ends. The anchor of a point that moves out faster than the anchor follows the point.
bool ends(ContactAnchor& anchor, double depth);

}  // namespace anchor_law
}  // namespace softhand
