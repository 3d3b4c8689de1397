// The points of a skin at which contact happens.
#pragma once

#include <functional>
#include <vector>

#include "model/triangle_mesh.hpp"

namespace softhand::builder {

struct ContactSample {
  Vector3 position = Vector3::Zero();  ///< on a triangle of the skin, m
  double area = 0;                     ///< of the skin that is nearest to this sample, m^2
};

/// Spreads samples over the skin. Each point of the skin has a sample within about `spacing` m of it, and no two
/// samples are nearer than that. The areas sum to the skin's area. The same input gives the same bits.
std::vector<ContactSample> sample_contacts(const TriangleMesh& skin,
                                           const std::function<double(const Vector3&)>& spacing);

}  // namespace softhand::builder
