// Tetrahedra of a flexible object, by the mesher of the hand.
#pragma once

#include "object_builder/build_object.hpp"

namespace softhand::builder {

/// Throws std::runtime_error with the file and what was expected: a closed, outward mesh without self-intersections and
/// handles. `scale`: m per unit of the mesh.
SoftBody build_soft_body(const SoftSource& source, double scale);

}  // namespace softhand::builder
