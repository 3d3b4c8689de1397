// The contacts of the hand with one object as patches, for another hand that touches this object too
// (energies/other_hands.hpp).
#pragma once

#include "energies/contact.hpp"
#include "messages/messages.hpp"
#include "model/hand_model.hpp"
#include "model/state.hpp"

namespace softhand {

/// Adds a patch for each bone whose skin presses on the object in the slot, at the end of the last step. `object` is
/// its id. If there is no place for all, those with the least force are left out. Does not write velocities. Does not
/// allocate.
///
/// The stiffness is that of contact and tissue between the object and the bone: twice the secant of the tissue in
/// series with the contact. The secant is the normal force over the distance by which the bone has approached the
/// patch since rest. Tissue gets stiffer under load, and twice is an upper bound of its tangent.
void write_patches(const HandModel& hand, const ContactSet& contacts, const State& state, int slot,
                   std::uint32_t object, BoundedVector<ContactPatch, kMaxPatches>& patches);

}  // namespace softhand
