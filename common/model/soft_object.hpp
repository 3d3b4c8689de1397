// A flexible object and its place in a scene, without the simulation of it (soft_objects.hpp).
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "math/types.hpp"
#include "model/object_model.hpp"
#include "model/tissue_model.hpp"

namespace softhand {

/// A flexible object and its place in the scene.
struct SoftObject {
  std::string name;  ///< in the scene
  std::shared_ptr<const SoftBody> body;
  Pose pose;                          ///< of its frame in the world, where it starts at rest
  Vector3 gravity = Vector3::Zero();  ///< m/s^2
  /// The world moves it while no hand owns it. Otherwise the hand's process owns it all the time.
  bool is_shared = false;
  double contact_stiffness = 9e8;  ///< k_c of the world's contacts with it, N/m^3
  std::string file_name = {};      ///< of the object in its file
  std::string file_sha256 = {};    ///< of the file's bytes
};

/// kg.
double mass_of(const SoftBody& body);

/// Appends the tetrahedra, the surface and the contact points of a body, and its material. Its nodes have the numbers
/// from `first` on. They are not appended.
void append_body(TissueModel& model, const SoftBody& body, std::int32_t first, std::uint8_t node_body);

}  // namespace softhand
