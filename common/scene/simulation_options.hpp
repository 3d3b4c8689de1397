// Options of the hand's physics: section [hand.simulation] of a scene.
#pragma once

#include "runtime/options.hpp"
#include "solver/newton_solver.hpp"

namespace softhand {

struct SimulationOptions {
  double coupling_damping_ratio = 0.3;
  double contact_stiffness = 12000;
  bool gravity = false;
  double untangle_patience = 0.1;
  std::int64_t threads = 1;
  SolverOptions solver;
};

inline void describe(OptionVisitor& v, SimulationOptions& o) {
  v.number("coupling_damping_ratio", o.coupling_damping_ratio, "1", {0, 5},
           "Damping of each bone relative to the skeleton that it is coupled to, 1 = critical for the bone and the "
           "tissue around it; more follows the noise of a tracker's velocity.");
  v.number("contact_stiffness", o.contact_stiffness, "N/m", {1, 1e8},
           "k_c of eqs. 32 and 33, for a node of mean skin area.");
  v.flag("gravity", o.gravity, "Weight of the hand itself; off, because the user's arm carries it.");
  v.number("untangle_patience", o.untangle_patience, "s", {0, 10},
           "Tissue that is inside out, wound round its bones or hooked behind an object in two looks so far apart is "
           "put back to "
           "where its bones carry it, if that releases energy; 0 = never.");
  v.integer("threads", o.threads, "", {1, 2},
            "2: a second thread takes half of the tissue and of the factorisation, with the same bits. Both are pinned "
            "to cores of their own, so the machine needs a free one.");
  describe_section(v, "solver", "The minimiser of the incremental potential.", o.solver);
}

}  // namespace softhand
