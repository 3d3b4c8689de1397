// How far a hand's tissue is from the shape that it takes by itself: what damage a run has left.
#pragma once

#include "model/hand_model.hpp"
#include "model/state.hpp"

namespace softhand {

/// Metres, root mean square over the nodes of `state`: their distances from the equilibrium that the tissue, touching nothing, reaches from its rest shape, each node carried by its
/// nearest bone, while the bones stay where `state` has them. 0 without tissue.
double rest_error(const HandModel& hand, const State& state);

}  // namespace softhand
