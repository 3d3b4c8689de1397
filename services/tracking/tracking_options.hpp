// Options of the tracking loop: section [tracking] of a scene.
#pragma once

#include "device/tracked_input.hpp"
#include "runtime/options.hpp"

namespace softhand {

struct TrackingOptions {
  double rate_hz = 1000;
  double stiffness_ratio = 15;
  double feedback_ratio = 0.1;
  double mass_fraction = 0.1;
  double damping_ratio = 1;
  double simulated_stale_after = 0.04;
  TrackedInputOptions input;
};

inline void describe(OptionVisitor& v, TrackingOptions& o) {
  v.number("rate_hz", o.rate_hz, "Hz", {50, 10000}, "Rate of the tracking loop. The time step is its reciprocal.");
  v.number("stiffness_ratio", o.stiffness_ratio, "1", {1, 1000},
           "Stiffness of the spring from the tracked to the intermediate skeleton, divided by the stiffness from the "
           "intermediate to the simulated skeleton (hand file).");
  v.number("feedback_ratio", o.feedback_ratio, "1", {0, 1},
           "Stiffness of the spring from the simulated skeleton back to the intermediate one, divided by the same.");
  v.number("mass_fraction", o.mass_fraction, "1", {0.001, 1},
           "Mass and inertia of an intermediate bone, divided by those of the bone in the hand file.");
  v.number("damping_ratio", o.damping_ratio, "1", {0.1, 3},
           "Damping ratio of the intermediate bones against the world. 1 = critical.");
  v.number(
      "simulated_stale_after", o.simulated_stale_after, "s", {0.005, 1},
      "If no simulated skeleton came for this time, its spring and all coupling forces are zero. A skeleton that is "
      "older than this at its arrival does not count. Both times are on the simulated clock, so at a slower pace "
      "they take longer.");
  describe_section(v, "input", "Processing of tracker samples.", o.input);
}

}  // namespace softhand
