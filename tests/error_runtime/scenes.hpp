// The scenes of error against run time. They are short and smooth, and each setting gets the same input. The loop of a
// hand plays a scene alone, in a world whose objects do not move by themselves.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "model/hand_model.hpp"
#include "model/soft_object.hpp"
#include "trackers/replay/motion.hpp"
#include "world/world_options.hpp"

namespace softhand::error_runtime {

struct Trajectory;

/// How close a run with the live budget must stay to R0.
struct LiveBound {
  double tissue_rms_mm = 0;
  std::optional<double> force_error;  ///< relative
};

inline constexpr double kFloor = 0;  ///< m; objects that can move stand on the plane y = kFloor

struct Scene {
  std::string name;       ///< unique
  std::string statement;  ///< the event in one line
  double seconds = 1;     ///< a multiple of 1/30
  std::vector<ObjectOptions> objects;
  std::vector<std::string> options;  ///< "key=value" for HandOptions
  bool grasp = false;                ///< the default must be within 0.1 mm and 2 % of R0
  /// Targets over time. The motion is made once for all meshes.
  std::function<std::shared_ptr<const Motion>(const HandModel&)> motion;
  /// Describes what the scene fails to show. Empty if the scene does what its name says.
  std::function<std::string(const Trajectory&)> missing;
  std::optional<LiveBound> live{};
  /// Another hand than the shipped one, made from this hand file; null: the shipped one.
  std::function<HandModel(const std::string& file)> fitted_hand{};
  /// They rest on the objects before the scene starts.
  std::vector<SoftObject> soft_objects{};
};

/// free_motion, fist, pinch_lift, power_grasp, table_slide, deep_block, clutter_100, flexible_ball, and with the path
/// of a recording recorded_grasp and fist_recorded. Throws where the recording cannot be read.
std::vector<Scene> all_scenes(const std::string& recording = "");

/// Scenes that belong to the study but cannot be run yet, and the reason.
struct NotBuilt {
  std::string name;
  std::string reason;
};
std::vector<NotBuilt> scenes_not_built(const std::string& recording = "");

}  // namespace softhand::error_runtime
