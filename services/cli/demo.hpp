// Demonstrations: scenes that say in their key `watch` what to watch.
#pragma once

#include <string>
#include <vector>

namespace softhand {

struct Demo {
  std::string name;  ///< file name of the scene without .toml
  std::string watch;
  std::string scene;  ///< path
};

/// The scenes of a folder that have the key `watch`, by name. A file that is not TOML is skipped. Throws
/// std::runtime_error if the folder is missing or has no such scene.
std::vector<Demo> find_demos(const std::string& folder);

/// The demonstration of this name. Throws std::runtime_error with all names if there is none.
const Demo& find_demo(const std::vector<Demo>& demos, const std::string& name);

/// What `softhand demo` prints: a line per demonstration, and how to start one.
std::string demo_list(const std::vector<Demo>& demos);

}  // namespace softhand
