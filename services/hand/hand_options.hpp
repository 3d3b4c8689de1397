// Options of the hand simulation: section [hand] of a scene.
#pragma once

#include <string>

#include "device/tracked_input.hpp"
#include "runtime/options.hpp"
#include "scene/simulation_options.hpp"

namespace softhand {

struct HandOptions {
  double rate_hz = 90;
  std::string model = "right_1450.hand.json";  ///< or "auto"
  std::string side = "right";
  bool direct = false;
  bool phase_lock = true;
  double extrapolation_limit = 0.05;
  TrackedInputOptions tracked_input;
  double stale_after = 0.1;
  double reposition_distance = 0.5;
  double near_distance = 0.05;
  double release_time = 0.1;
  std::int64_t mirrored_objects = 16;
  std::int64_t static_objects = 4;
  std::int64_t object_joints = 8;
  SimulationOptions simulation;
};

inline void describe(OptionVisitor& v, HandOptions& o) {
  v.number("rate_hz", o.rate_hz, "Hz", {10, 2000}, "Rate of the hand simulation. The time step is its reciprocal.");
  v.string("model", o.model,
           "Hand file: a path, or a name in config/hands. auto: softhand-hand chooses among right_400, 750, 1450, 3000 "
           "and 6000. It takes the finest with at least two fast steps in its budget on this machine, or four with "
           "flexible objects. If none has, it takes right_400. `softhand simulate` and other processes then use "
           "right_1450.");
  v.choice("side", o.side, {"left", "right"}, "Side of the hand. A file of the other side is mirrored.");
  v.flag("direct", o.direct,
         "Leave out the intermediate layer and couple to the tracked skeleton (figure 2B). For matched rates.");
  v.flag("phase_lock", o.phase_lock,
         "Start each step when the tracker's sample has just arrived. Needs a tracker of the same rate, or of a "
         "fraction or a multiple of it. Not with hand.simulation.other_hands.");
  v.number("extrapolation_limit", o.extrapolation_limit, "s", {0, 0.2},
           "A target pose is extrapolated by its age, but at most by this time.");
  v.number("stale_after", o.stale_after, "s", {0.01, 10},
           "If the newest skeleton is older than this, the status counts the step as stale.");
  v.number("reposition_distance", o.reposition_distance, "m", {0.1, 100},
           "If the target's wrist is farther than this from the simulated wrist, the whole hand is moved there at "
           "once. With hand.direct, a jump beyond hand.tracked_input.reposition_distance does this instead.");
  v.number("near_distance", o.near_distance, "m", {0.005, 1},
           "Objects nearer to the hand than this are mirrored in its simulation. Fast objects are mirrored earlier.");
  v.number("release_time", o.release_time, "s", {0, 1},
           "Time after the last contact for which the hand still owns an object.");
  v.integer("mirrored_objects", o.mirrored_objects, "1", {0, static_cast<double>(kMaxMirrored)},
            "Slots for objects that can move. The nearest objects get them. If the scene lists objects, never more "
            "slots than movable objects in it. An object that nothing touches costs almost nothing.");
  v.integer(
      "static_objects", o.static_objects, "1", {0, 64},
      "Slots for objects that cannot move (a table). If the scene lists objects, never more slots than fixed objects "
      "in it.");
  v.integer("object_joints", o.object_joints, "1", {0, 64},
            "Places for joints between objects. Objects that joints connect get slots together. If the scene lists "
            "objects, never more places than joints in it.");
  describe_section(v, "tracked_input", "Input without the intermediate layer.", o.tracked_input);
  describe_section(v, "simulation", "Energies and solver.", o.simulation);
}

}  // namespace softhand
