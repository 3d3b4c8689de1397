// Another engine on the same tetrahedra, load and step: Bullet's deformable bodies.
#pragma once

#include <string>

#include "error_runtime/study.hpp"

namespace softhand::error_runtime {

/// Soft fingers without bones, their palm held, fall under their own weight: one material, no strain limit, no contact, which is what both can do. Errors are
/// against this project's converged run. `hand`: the name of a hand file.
PeerStudy study_peer(const std::string& hand);

}  // namespace softhand::error_runtime
