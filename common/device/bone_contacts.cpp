#include "device/bone_contacts.hpp"

#include <algorithm>
#include <cmath>

#include "messages/convert.hpp"

namespace softhand {

BoneContacts sum_contacts(const Contacts& contacts) {
  BoneContacts sums{};
  for (const Contact& contact : contacts.contacts) {
    if (contact.body >= kBodyCount || !all_finite(contact.force)) continue;
    BoneContact& sum = sums[contact.body];
    const Vector3 force = to_vector(contact.force), normal = to_vector(contact.normal);
    sum.force += force;
    const double weight = force.dot(normal);
    if (!(weight > 0) || !all_finite(contact.point) || !all_finite(contact.velocity)) continue;
    sum.normal += weight * normal;
    sum.point += weight * to_vector(contact.point);
    sum.velocity += weight * to_vector(contact.velocity);
    sum.weight += weight;
  }
  for (const NearContact& near : contacts.near) {
    if (near.body >= kBodyCount || !(near.gap > 0) || !all_finite(near.point) || !all_finite(near.normal) ||
        !all_finite(near.velocity))
      continue;
    BoneContact& sum = sums[near.body];
    if (sum.weight > 0) continue;
    sum.normal = to_vector(near.normal);
    sum.point = to_vector(near.point);
    sum.velocity = to_vector(near.velocity);
    sum.weight = 1;
    sum.gap = near.gap;
  }
  return sums;
}

void write_local_model(const BoneContact& contact, const BoneCoupling& coupling, double stretch, const Vector3& moved,
                       double age, BoneSample& out) {
  const double length = contact.normal.norm();
  // Contacts from opposite sides have no common plane.
  if (!(length > 0.5 * contact.weight)) return;
  const Vector3 normal = contact.normal / length;
  const Vector3 velocity = contact.velocity / contact.weight;
  const double gap = contact.gap > 0 ? contact.gap + normal.dot(moved - age * velocity) : 0;
  if (contact.gap > 0) {
    // Exactly 0 would say that the bone touches.
    if (gap == 0 || !(std::abs(gap) <= kMaxContactGap)) return;
  } else if (!(to_vector(out.coupling_force).dot(normal) > 0)) {
    return;
  }
  const double stiffness = coupling.stiffness * stretch > coupling.cap ? coupling.cap / stretch : coupling.stiffness;
  out.contact_gap = gap;
  out.contact_point = to_wire(Vector3(contact.point / contact.weight));
  out.contact_normal = to_wire(normal);
  out.contact_velocity = to_wire(velocity);
  out.contact_stiffness = std::min(stiffness, kMaxContactStiffness);
  out.contact_damping = std::min(2 * std::sqrt(stiffness * coupling.mass), kMaxContactDamping);
}

}  // namespace softhand
