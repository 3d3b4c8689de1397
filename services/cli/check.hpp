// What is checked of a scene before anything is started on it.
#pragma once

#include "scene_file.hpp"

namespace softhand {

/// Reads a scene and makes sure that its processes can start on it: the hand loads, the motion can be made, the mounts
/// of trackers are orientations, the intermediate layer and the world are stable. Throws ConfigError or
/// std::invalid_argument with file and reason.
Scene read_checked_scene(const std::string& path, const std::vector<std::string>& overrides = {});

/// A rig and not a scene. A file that is not TOML at all is neither; reading it as a scene will say what is wrong with
/// it.
bool is_rig(const std::string& path);

}  // namespace softhand
