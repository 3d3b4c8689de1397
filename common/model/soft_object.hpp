// A flexible object and its place in a scene, without the simulation of it (soft_objects.hpp).
#pragma once

#include <memory>
#include <string>

#include "math/types.hpp"
#include "model/object_model.hpp"

namespace softhand {

/// A flexible object and its place in the scene.
struct SoftObject {
  std::string name;  ///< in the scene
  std::shared_ptr<const SoftBody> body;
  Pose pose;                          ///< of its frame in the world, where it starts at rest
  Vector3 gravity = Vector3::Zero();  ///< m/s^2
  std::string file_name = {};         ///< of the object in its file
  std::string file_sha256 = {};       ///< of the file's bytes
};

}  // namespace softhand
