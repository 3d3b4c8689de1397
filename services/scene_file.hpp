// A scene: one TOML file that all processes of a rig read, each for its own sections. Every option of every process is
// described here, so that a misspelt key is refused by whoever reads the file first.
#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "cli/outcome.hpp"
#include "device/device_loop.hpp"
#include "hand/hand_options.hpp"
#include "haptics/log/haptic_log_driver.hpp"
#include "model/hand_model.hpp"
#include "runtime/config.hpp"
#include "scene/hand_simulation.hpp"
#include "tactile/log/tactile_log_driver.hpp"
#include "trackers/landmarks/landmarks_options.hpp"
#include "trackers/replay/generator.hpp"
#include "trackers/replay/replay_tracker.hpp"
#include "trackers/webxr/webxr_options.hpp"
#include "tracking/tracking_options.hpp"
#include "viewer/viewer_options.hpp"
#include "world/world_options.hpp"

namespace softhand {

struct SimulateOptions {
  double seconds = 0;
  double transport_ms = 0.1;
  double hand_compute_fraction = 0.6;
};
inline void describe(OptionVisitor& v, SimulateOptions& o) {
  v.number("seconds", o.seconds, "s", {0, 86400},
           "How long `softhand simulate` runs; 0 = to the end of the motion and half a second more.");
  v.number("transport_ms", o.transport_ms, "ms", {0, 100}, "Delay of every message on the virtual clock.");
  v.number("hand_compute_fraction", o.hand_compute_fraction, "1", {0, 1},
           "When the hand's results leave, as a part of its period after its inputs were read.");
}

struct JudgeOptions {
  std::string object;
};
inline void describe(OptionVisitor& v, JudgeOptions& o) {
  v.string("object", o.object, "Name of the object that is grasped; empty = the first that can move.");
}

struct HapticOptions {
  DeviceLoopOptions loop;
  HapticLogOptions driver;
};
inline void describe(OptionVisitor& v, HapticOptions& o) {
  describe(v, o.loop);
  describe_section(v, "log", "The simulated glove of softhand-haptic-log.", o.driver);
}
struct TactileOptions {
  DeviceLoopOptions loop;
  TactileLogOptions driver;
};
inline void describe(OptionVisitor& v, TactileOptions& o) {
  describe(v, o.loop);
  describe_section(v, "log", "The simulated tactile glove of softhand-tactile-log.", o.driver);
}

struct SceneOptions {
  std::string name = "scene";
  std::int64_t user = 0;
  std::string motion;  ///< recording, or empty
  bool fit_hand = true;
  GeneratorOptions generator;
  ReplayOptions tracker;
  WebXrOptions tracker_webxr;
  LandmarksOptions tracker_landmarks;
  TrackingOptions tracking;
  HandOptions hand;
  WorldOptions world;
  std::vector<ObjectOptions> objects;
  HapticOptions haptic;
  TactileOptions tactile;
  ViewerOptions viewer;
  SimulateOptions simulate;
  JudgeOptions judge;
};
void describe(OptionVisitor& v, SceneOptions& o);

struct Scene {
  std::string path;
  SceneOptions options;
  std::vector<AppliedOverride> overrides;
};

/// Reads a scene and applies `--set` assignments. Relative paths inside are sought beside the file, in the folder of
/// their kind beside its folder, and from where we are. Throws ConfigError.
Scene read_scene(const std::string& path, const std::vector<std::string>& overrides = {});

/// The motion that the scene's tracker plays: its recording, or the generator's. `hand` as from `load_scene_hand`.
std::shared_ptr<const Motion> make_scene_motion(const Scene& scene, const HandModel& hand);

/// Hand files of which `hand.model = "auto"` takes one, coarsest first. Joints and bones are the same in all of them.
inline constexpr std::array kHandSizes{"right_400.hand.json", "right_750.hand.json", "right_1450.hand.json",
                                       "right_3000.hand.json", "right_6000.hand.json"};
bool chooses_hand_size(const Scene& scene);

/// The hand of the scene: on its side, and where the scene plays a recording, fitted to the recording's bones. Where
/// the size is chosen at start, the hand of 1,450 nodes stands for it: results without a clock must not depend on the
/// machine, and other processes need only the bones. Throws with file and reason.
HandModel load_scene_hand(const Scene& scene);
/// The same from another hand file.
HandModel load_scene_hand(const Scene& scene, const std::string& file);
/// All hands that may turn out to be the scene's: one, or all of `kHandSizes`.
std::vector<HandModel> load_possible_hands(const Scene& scene);

/// The hand's end of U'_crb between a mirrored object and its copy in the world: a spring in mode symmetric, none in
/// mode owner.
ObjectSpring object_spring(const WorldOptions& world);

/// Which hand the scene is about: its user, and the side of its recording or else of `hand.side`.
HandKey hand_key(const Scene& scene);

/// How a run of this scene is judged; `motion_start` on the messages' clock.
OutcomeFrame outcome_frame(const Scene& scene, Nanoseconds motion_start);

}  // namespace softhand
