// Checks of a scene before any process is started with it.
#pragma once

#include "scene_file.hpp"

namespace softhand {

/// Reads a scene and checks that its processes can start with it. The hand must load, and the motion must be possible.
/// The mounts of the trackers must be orientations. The intermediate layer and the world must be stable. Throws
/// ConfigError or std::invalid_argument with file and reason.
Scene read_checked_scene(const std::string& path, const std::vector<std::string>& overrides = {});

/// True for a rig, false for a scene. A file that is not valid TOML also returns false: reading it as a scene then
/// reports the syntax error.
bool is_rig(const std::string& path);

}  // namespace softhand
