// Sums the contacts of each bone into the plane of the local model (BoneSample::contact_point and following).
#pragma once

#include <array>

#include "math/types.hpp"
#include "messages/messages.hpp"
#include "model/skeleton.hpp"

namespace softhand {

/// Sums over the contacts of one bone, or the nearest object. The weight is the normal force.
struct BoneContact {
  Vector3 force = Vector3::Zero();     ///< N, on the bone's tissue
  Vector3 normal = Vector3::Zero();    ///< N, weighted
  Vector3 point = Vector3::Zero();     ///< N m, weighted
  Vector3 velocity = Vector3::Zero();  ///< N m/s, weighted, of the objects
  double weight = 0;                   ///< N; 1 for an object that is near
  double gap = 0;                      ///< m, > 0 if the bone touches nothing and an object is near
};
using BoneContacts = std::array<BoneContact, kBodyCount>;

/// Contacts with a body out of range or with NaN are ignored. Real-time.
BoneContacts sum_contacts(const Contacts& contacts);

/// The coupling between the user's bone and the simulated one: force = stiffness times stretch, at most `cap`.
struct BoneCoupling {
  double stiffness = 0;  ///< N/m
  double cap = 0;        ///< N
  double mass = 0;       ///< kg of the simulated bone
};

/// Writes the local model if the bone touches something and the coupling pushes it away from there, or if an object is
/// near. `out.coupling_force` must be set. `stretch` (m) is the length of the coupling. `moved` (m) is the way of the
/// user's bone against the simulated one when the gap was measured. The gap is `age` (s) old: since then the object
/// moved with its velocity.
///
/// The stiffness is that of the coupling alone (its secant at the cap), as if object and tissue were rigid. So the
/// local model is never softer than the simulation. Its error dissipates: a force that rises too much while the user
/// presses, and falls too much while the user lets go, takes more energy than it gives back. The damping is that of the
/// hand's coupling, 2 sqrt(k m).
void write_local_model(const BoneContact& contact, const BoneCoupling& coupling, double stretch, const Vector3& moved,
                       double age, BoneSample& out);

}  // namespace softhand
