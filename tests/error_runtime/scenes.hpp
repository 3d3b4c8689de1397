// The scenes of error against run time: short, smooth, the same input for every setting. A hand's loop plays them
// alone, in a world that stands still.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "model/hand_model.hpp"
#include "trackers/replay/motion.hpp"
#include "world/world_options.hpp"

namespace softhand::error_runtime {

struct Trajectory;

inline constexpr double kFloor = 0;  ///< m: what can move stands on the plane y = kFloor

struct Scene {
  std::string name;       ///< unique
  std::string statement;  ///< what happens, in a line
  double seconds = 1;     ///< a multiple of 1/30
  std::vector<ObjectOptions> objects;
  std::vector<std::string> options;  ///< "key=value" for HandOptions
  bool grasp = false;                ///< the default must be within 0.1 mm and 2 % of R0
  /// Targets over time; made once, for every mesh.
  std::function<std::shared_ptr<const Motion>(const HandModel&)> motion;
  /// What is missing for the scene to be what it is called; empty when nothing is.
  std::function<std::string(const Trajectory&)> missing;
};

/// free_motion, fist, pinch_lift, power_grasp, table_slide, deep_block, clutter_100.
const std::vector<Scene>& all_scenes();

/// Scenes that belong among them and cannot be run: their names and why.
struct NotBuilt {
  std::string name;
  std::string reason;
};
const std::vector<NotBuilt>& scenes_not_built();

}  // namespace softhand::error_runtime
