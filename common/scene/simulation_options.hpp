// Options of the hand's physics: section [hand.simulation] of a scene.
#pragma once

#include "runtime/options.hpp"
#include "solver/newton_solver.hpp"

namespace softhand {

struct SimulationOptions {
  double coupling_damping_ratio = 0.3;
  double contact_stiffness = 9e8;
  bool skin_contact = false;
  double skin_friction = 0.8;
  bool gravity = false;
  double untangle_patience = 0.1;
  std::int64_t threads = 1;
  SolverOptions solver;
};

inline void describe(OptionVisitor& v, SimulationOptions& o) {
  v.number("coupling_damping_ratio", o.coupling_damping_ratio, "1", {0, 5},
           "Damping of each bone relative to the skeleton that it is coupled to. 1 = critical for the bone and the "
           "tissue around it. With higher values the bone follows the noise of a tracker's velocity.");
  v.number("contact_stiffness", o.contact_stiffness, "N/m^3", {1e4, 1e12},
           "k_c of eqs. 32 and 33: the contact stiffness of the skin per area.");
  v.flag("skin_contact", o.skin_contact,
         "The skin of the hand touches itself: finger against finger, finger against palm, and the thumb across the "
         "hand. Without it, fingers pass through each other and through the palm.");
  v.number("skin_friction", o.skin_friction, "1", {0, 100}, "Friction coefficient of skin on skin.");
  v.flag("gravity", o.gravity,
         "Gravity acts on the hand itself. Off by default, because the user's arm carries the hand's weight.");
  v.number("untangle_patience", o.untangle_patience, "s", {0, 10},
           "Tissue that is inverted, wound around its bones or hooked behind an object in two checks this far apart is "
           "moved back to its rest place relative to the bones, if that releases energy. 0 = never.");
  v.integer("threads", o.threads, "", {1, 2},
            "2: a second thread computes half of the tissue and of the factorisation. The result has the same bits. "
            "Both threads are pinned to cores of their own, so the machine needs a free core.");
  describe_section(v, "solver", "The minimiser of the incremental potential.", o.solver);
}

}  // namespace softhand
