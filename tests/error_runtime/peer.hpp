// Another engine with the same tetrahedra, load and step: Bullet's deformable bodies.
#pragma once

#include <string>

#include "error_runtime/study.hpp"

namespace softhand::error_runtime {

/// Soft fingers without bones fall under their own weight, with the palm held. There is one material, no strain limit
/// and no contact, because both engines can do this. Errors are against this project's converged run. `hand` is the
/// name of a hand file.
PeerStudy study_peer(const std::string& hand);

/// The first steps of the same fall. Both engines have their default settings and take their steps in turn.
struct PeerSteps {
  double own_seconds = 0, bullet_seconds = 0;  ///< medians of the thread's CPU time
  double own_rms_mm = 0, bullet_rms_mm = 0;    ///< skin error against this project's converged run, at the last step
};
PeerSteps compare_steps(const std::string& hand, int steps);

}  // namespace softhand::error_runtime
