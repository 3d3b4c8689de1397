// How near the bones of two fingers or of two hands come.
#pragma once

#include "model/hand_model.hpp"
#include "model/state.hpp"

namespace softhand {

/// The smallest gap between the phalanges of two different digits, metres. A phalanx is the capsule around its axis
/// with the smaller of its two radii. Negative: one finger is inside another. A finger that passes through another one
/// makes the gap nearly minus the sum of two radii on its way. `first_body`: of the hand's bones in the state.
double finger_gap(const HandModel& hand, const State& state, int first_body = 0);

/// The same between any two bones of two hands, without their forearms and carpi.
double hands_gap(const HandModel& one, int first_body_of_one, const HandModel& two, int first_body_of_two,
                 const State& state);

}  // namespace softhand
