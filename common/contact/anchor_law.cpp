#include "contact/anchor_law.hpp"

#include <cmath>
#include <utility>

namespace softhand::anchor_law {
namespace {

constexpr double kExitSpeed = 0.75;     // m/s, of the anchor of a point that started inside
constexpr double kAtStart = 1e-12;      // m; a stretch that moved less than this is at the step's start: rounding
constexpr double kLittleMotion = 1e-6;  // m per step; less than the stretch of the friction springs

Vector3 tangential(const ContactAnchor& anchor, const Vector3& v) { return v - anchor.normal.dot(v) * anchor.normal; }

}  // namespace

Matrix3 tangential_stiffness(const ContactAnchor& anchor, const AnchorOffset& o, bool exact) {
  const CoulombSpring spring = friction_of(anchor);
  if (!exact && o.moved < kAtStart) {
    if (anchor.fresh) return anchor.predicted_secant * (Matrix3::Identity() - o.normal * o.normal.transpose());
    return spring.tangent(o.stretch, o.normal, anchor.sliding);
  }
  return spring.tangent(o.stretch, o.normal);
}

void move_out(ContactAnchor& anchor, double time_step) {
  const double out = std::min(anchor.recess, kExitSpeed * time_step);
  anchor.anchor += out * anchor.normal;
  anchor.recess -= out;
}

double pressure_at(const ContactAnchor& anchor, const Vector3& place) {
  return anchor.stiffness * std::max(0.0, -anchor.normal.dot(place - anchor.anchor));
}

bool sticks(const ContactAnchor& anchor, const SurfacePoint& surface, double limit) {
  return limit > 0 && anchor.friction_stiffness * (surface.point - anchor.anchor).norm() <= limit;
}

void sweep(ContactAnchor& anchor, const AnchorPath& path, const SurfacePoint& surface) {
  const Vector3 moved = path.end - path.before;
  anchor.anchor = surface.point - (moved - surface.normal.dot(moved) * surface.normal);
  anchor.normal = surface.normal;
}

Ahead begin(ContactAnchor& anchor, const AnchorPath& path, double pressure_before, bool swept, double mass,
            double time_step) {
  const Vector3 next = path.end - anchor.anchor;
  // A swept plane is at the predicted end of the point's path, so it gives no stretch at the start.
  const Vector3 now = swept ? next : Vector3(path.start - anchor.anchor);
  const Ahead ahead{now, tangential(anchor, now), tangential(anchor, next - now)};
  if (anchor.fresh || anchor.missed) {
    const double depth = std::max(0.0, -anchor.normal.dot(next));
    const double inertia = mass / (time_step * time_step);
    anchor.friction_bound = anchor.friction * anchor.stiffness * depth * inertia / (inertia + anchor.stiffness);
    anchor.predicted_secant = anchor.friction_bound > 0 ? friction_of(anchor).secant(ahead.movement.norm()) : 0.0;
    anchor.stretch_origin = anchor.fresh ? ahead.stretch : Vector3(Vector3::Zero());
  } else {
    const double force = swept ? pressure_before : anchor.stiffness * std::max(0.0, -anchor.normal.dot(now));
    anchor.friction_bound = anchor.friction * force;
    anchor.stretch_origin.setZero();
  }
  anchor.sliding = anchor.sliding && ahead.stretch.dot(ahead.movement) > 0;
  return ahead;
}

void move_ahead(ContactAnchor& anchor, Ahead& ahead, const SurfacePoint& surface) {
  // The stretch follows the surface: it keeps its length and is rotated into the new plane.
  const Vector3 turned = Quaternion::FromTwoVectors(anchor.normal, surface.normal) * ahead.stretch;
  const Vector3 from_there = ahead.now + anchor.anchor - surface.point;
  anchor.anchor = surface.point;
  anchor.normal = surface.normal;
  ahead.stretch = tangential(anchor, from_there);
  anchor.stretch_origin = ahead.stretch - turned;
  anchor.ahead = true;
}

void finish_begin(ContactAnchor& anchor, const AnchorPath& path, const Ahead& ahead, double depth_before, bool swept) {
  // A minimiser begins with the point at its start and a fixed object at its end pose. The Hessian of friction there is
  // a choice. If the object moves little, the choice uses the predicted path of the point. If it moves far, the choice
  // uses the actual stretch.
  anchor.stretch_start = ahead.stretch - anchor.stretch_origin;
  const Vector3 first = tangential(anchor, path.first - anchor.anchor) - anchor.stretch_origin;
  if ((first - anchor.stretch_start).norm() < kLittleMotion) anchor.stretch_start = first;
  const Vector3 from_anchor = path.before - anchor.anchor;
  anchor.start_energy = stored_normal_energy(anchor, swept ? depth_before : anchor.normal.dot(from_anchor));
  const double elastic_stretch =
      anchor.friction_stiffness > 0 ? std::sqrt(2.0 * anchor.friction_energy / anchor.friction_stiffness) : 0.0;
  anchor.start_excess =
      swept ? 0.0 : std::max(0.0, (tangential(anchor, from_anchor) - anchor.stretch_origin).norm() - elastic_stretch);
}

Slide slide(ContactAnchor& anchor, double drag, const Pose& object, const Vector3& position, double time_step) {
  // The true stretch of a fresh anchor starts at the crossing. For an anchor ahead, it is the stretch of the energy.
  const bool ahead = std::exchange(anchor.ahead, false);
  if (!ahead) anchor.stretch_origin.setZero();
  anchor.fresh = anchor.two_sided = anchor.missed = false;
  const AnchorOffset o = offset(anchor, object, position);
  const double limit = anchor.friction * anchor.stiffness * std::max(0.0, -o.depth);
  const double stretch = o.stretch.norm();
  const double distance = o.depth < 0 ? friction_of(anchor).slide(stretch, limit) : 0.0;
  // A contact that ends stores no energy.
  const double elastic_stretch =
      anchor.friction_stiffness > 0 ? std::min(stretch - distance, limit / anchor.friction_stiffness) : 0.0;
  Slide result;
  result.heat = drag * std::max(0.0, stretch - elastic_stretch - anchor.start_excess);
  anchor.friction_energy = 0.5 * anchor.friction_stiffness * elastic_stretch * elastic_stretch;
  anchor.sliding = distance > 0;
  anchor.slip_speed = distance / time_step;
  result.movement = std::exchange(anchor.stretch_origin, Vector3::Zero());
  result.moves = anchor.sliding || ahead;
  if (anchor.sliding) result.movement += distance / stretch * (object.orientation.conjugate() * o.stretch);
  return result;
}

void place(ContactAnchor& anchor, const SurfacePoint& surface) {
  anchor.normal = surface.normal;
  anchor.anchor = surface.point - anchor.recess * anchor.normal;
}

Stored stored(const ContactAnchor& anchor, const AnchorOffset& offset) {
  Stored result;
  result.normal = stored_normal_energy(anchor, offset.depth);
  if (anchor.friction_stiffness > 0) {
    const double limit = anchor.friction * anchor.stiffness * std::max(0.0, -offset.depth);
    const double elastic_stretch = std::min(offset.stretch.norm(), limit / anchor.friction_stiffness);
    result.friction = 0.5 * anchor.friction_stiffness * elastic_stretch * elastic_stretch;
  }
  return result;
}

bool ends(ContactAnchor& anchor, double depth) {
  if (depth > 0 && anchor.recess > 0) {
    const double out = std::min(depth, anchor.recess);
    anchor.anchor += out * anchor.normal;
    anchor.recess -= out;
    return depth > out;
  }
  return depth >= 0 && !(anchor.recess > 0);
}

}  // namespace softhand::anchor_law
