// Another engine on the same tetrahedra, load and step: Bullet's deformable bodies.
#pragma once

#include <string>

#include "error_runtime/study.hpp"

namespace softhand::error_runtime {

/// Soft fingers without bones, their palm held, fall under their own weight: one material, no strain limit, no contact,
/// which is what both can do. Errors are against this project's converged run. `hand`: the name of a hand file.
PeerStudy study_peer(const std::string& hand);

/// The first steps of the same fall, both engines as they come, which take a step in turn.
struct PeerSteps {
  double own_seconds = 0, bullet_seconds = 0;  ///< medians, of the thread's own work
  double own_rms_mm = 0, bullet_rms_mm = 0;    ///< of the skin, from this project's converged run, over the last step
};
PeerSteps compare_steps(const std::string& hand, int steps);

}  // namespace softhand::error_runtime
