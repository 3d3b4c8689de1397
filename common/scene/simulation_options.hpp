// Options of the hand's physics: section [hand.simulation] of a scene, and the spring to the copies of objects.
#pragma once

#include <array>

#include "runtime/options.hpp"
#include "solver/solver_options.hpp"

namespace softhand {

/// Prony branches of the tissue (energies/relaxing_tissue.hpp). The weights are those of a material by its name in the
/// hand file. Their sum must be below 1. Other materials have no branches.
struct RelaxationOptions {
  using Branches = std::array<double, 3>;
  bool active = false;
  Branches time_constants{0.004, 0.07, 1.4};
  Branches pulp{0.25, 0.25, 0.25}, palm{}, back{}, knuckle{};
};

inline void describe(OptionVisitor& v, RelaxationOptions& o) {
  v.flag("active", o.active, "The tissue relaxes, as that of people. Off by default: it costs time.");
  v.numbers("time_constants", o.time_constants.data(), 3, "s", {1e-4, 1e3},
            "Time constants of the three branches. The default is that of the human fingertip (Pawluk and Howe 1999).");
  const auto weights = [&v](const char* material, RelaxationOptions::Branches& of_material) {
    v.numbers(
        material, of_material.data(), 3, "1", {0, 1},
        "Share of the stress that relaxes with each time constant, for the material of this name. The sum must be "
        "below 1. All 0: no branches.");
  };
  weights("pulp", o.pulp);
  weights("palm", o.palm);
  weights("back", o.back);
  weights("knuckle", o.knuckle);
}

struct SimulationOptions {
  double coupling_damping_ratio = 0.3;
  double contact_stiffness = 9e8;
  bool skin_contact = false;
  double skin_friction = 0.8;
  bool gravity = false;
  bool other_hands = false;
  double untangle_patience = 0.1;
  std::int64_t threads = 1;
  RelaxationOptions relaxation;
  SolverOptions solver;
};

inline void describe(OptionVisitor& v, SimulationOptions& o) {
  v.number("coupling_damping_ratio", o.coupling_damping_ratio, "1", {0, 5},
           "Damping of each bone relative to the skeleton that it is coupled to. 1 = critical for the bone and the "
           "tissue around it. With higher values the bone follows the noise of a tracker's velocity.");
  v.number("contact_stiffness", o.contact_stiffness, "N/m^3", {1e4, 1e11},
           "k_c of eqs. 32 and 33: the contact stiffness of the skin per area.");
  v.flag("skin_contact", o.skin_contact,
         "The skin of the hand touches itself: finger against finger, finger against palm, and the thumb across the "
         "hand. Without it, fingers pass through each other and through the palm.");
  v.number("skin_friction", o.skin_friction, "1", {0, 100}, "Friction coefficient of skin on skin.");
  v.flag("gravity", o.gravity,
         "Gravity acts on the hand itself. Off by default, because the user's arm carries the hand's weight.");
  v.flag("other_hands", o.other_hands,
         "Other hands may touch the same objects (docs/two-hands.md). On in scenes with several `hands`.");
  v.number("untangle_patience", o.untangle_patience, "s", {0, 10},
           "Two checks this far apart look for tissue that is inverted, wound around its bones or hooked behind an "
           "object. What both find is moved to its rest place relative to the bones, if that releases energy. "
           "0 = never.");
  v.integer("threads", o.threads, "", {1, 2},
            "2: a second thread computes half of the tissue and of the factorisation. The result has the same bits. "
            "Both threads are pinned to cores of their own, so the machine needs a free core.");
  describe_section(v, "relaxation", "Relaxation of the tissue (docs/relaxation.md).", o.relaxation);
  describe_section(v, "solver", "The minimiser of the incremental potential.", o.solver);
}

/// U'_crb between a mirrored object and its copy in the world (mode symmetric). Zero stiffness: mode owner, without
/// this spring.
struct ObjectSpring {
  double linear_stiffness = 0;   ///< N/m
  double angular_stiffness = 0;  ///< N m/rad
  double damping_ratio = 0;      ///< relative to the critical damping of the object in the slot
};

}  // namespace softhand
