// How near the bones of two fingers come.
#pragma once

#include "model/hand_model.hpp"
#include "model/state.hpp"

namespace softhand {

/// The smallest gap between the phalanges of two different digits, metres. A phalanx is the capsule around its axis
/// with the smaller of its two radii. Negative: one finger is inside another. A finger that passes through another one
/// makes the gap nearly minus the sum of two radii on its way.
double finger_gap(const HandModel& hand, const State& state);

}  // namespace softhand
