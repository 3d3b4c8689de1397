// How far a hand's tissue is from the shape that it takes by itself: what damage a run has left.
#pragma once

#include "model/hand_model.hpp"
#include "model/state.hpp"

namespace softhand {

/// Metres, root mean square over the nodes: between the equilibrium that the tissue of `state` comes to when it is let
/// settle, and the one that it comes to from its rest shape, each node carried by its nearest bone. Bones stay where
/// `state` has them, and nothing touches the hand, so motion at the end of a run does not count. 0 without tissue.
double rest_error(const HandModel& hand, const State& state);

}  // namespace softhand
