// Lasting deformation of a hand's tissue after a run.
#pragma once

#include "model/hand_model.hpp"
#include "model/state.hpp"

namespace softhand {

/// Root mean square distance of the nodes between two equilibria of the tissue, metres. The first is the equilibrium
/// that the tissue of `state` settles to. The second starts from the rest shape, with each node moved rigidly with its
/// nearest bone. The bones stay where `state` has them, and nothing touches the hand. So motion at the end of a run
/// does not count. 0 without tissue.
double rest_error(const HandModel& hand, const State& state);

}  // namespace softhand
