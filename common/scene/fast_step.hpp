// How long a fast step takes here and now, for those who turn time into work.
#pragma once

#include <functional>

#include "model/hand_model.hpp"
#include "scene/simulation_options.hpp"

namespace softhand {

/// Seconds of a fast step (solver/step_work.hpp) of `hand` with these options and `mirrored_slots` and `static_slots` for objects: the median of
/// `steps` steps of one Newton iteration that nothing touches, each over the work that it counted. `clock`: seconds from any origin; empty: a steady
/// clock. Allocates. Ask when the machine is as busy as it will be.
double measure_fast_step(const HandModel& hand, const SimulationOptions& options, int mirrored_slots, int static_slots, int steps = 30,
                         const std::function<double()>& clock = {});

}  // namespace softhand
