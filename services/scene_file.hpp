// A scene is one TOML file. All processes of a rig read it, and each uses its own sections. All options are described
// here, except those of drivers: a driver describes its own section, and programs without this driver ignore it.
// `softhand` has the sections of all drivers, so it refuses a misspelt key before it starts a process.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "cli/hands_outcome.hpp"
#include "cli/outcome.hpp"
#include "cli/skin_outcome.hpp"
#include "cli/soft_outcome.hpp"
#include "device/device_loop.hpp"
#include "device/driver.hpp"
#include "device/user_hand.hpp"
#include "hand/hand_options.hpp"
#include "haptics/log/haptic_log_driver.hpp"
#include "model/hand_model.hpp"
#include "model/soft_object.hpp"
#include "runtime/config.hpp"
#include "runtime/flight_options.hpp"
#include "tactile/log/tactile_log_driver.hpp"
#include "trackers/replay/generator.hpp"
#include "trackers/replay/replay_tracker.hpp"
#include "tracking/tracking_options.hpp"
#include "viewer/viewer_options.hpp"
#include "world/world_options.hpp"

namespace softhand {

struct SimulateOptions {
  double seconds = 0;
  double transport_ms = 0.1;
  double hand_compute_fraction = 0.6;
  double hand_phase = 0.017;
};
inline void describe(OptionVisitor& v, SimulateOptions& o) {
  v.number("seconds", o.seconds, "s", {0, 86400},
           "Simulated time of `softhand simulate`. 0 = until half a second after the end of the motion.");
  v.number("transport_ms", o.transport_ms, "ms", {0, 100}, "Delay of every message on the virtual clock.");
  v.number("hand_compute_fraction", o.hand_compute_fraction, "1", {0, 1},
           "Delay from reading the hand's inputs to publishing its results, as a fraction of its period.");
  v.number("hand_phase", o.hand_phase, "1", {0, 1},
           "Delay of the loops of each hand after those of the hand before it, as a fraction of their periods.");
}

struct JudgeOptions {
  std::string object;
  std::string joint;
  Goal goal;
  std::int64_t times = 1;
  SkinGoal skin;
  SoftGoal soft;
  HandsGoal hands;
};
inline void describe(OptionVisitor& v, JudgeOptions& o) {
  v.string("object", o.object, "Name of the object that is grasped. Empty = the first object that can move.");
  v.number("travel", o.goal.travel, "m", {0, 10},
           "The run succeeds only if the object moves at least this far from its first place. 0 = not asked for.");
  v.number("tilt", o.goal.tilt, "rad", {0, 3.1}, "The same for its largest tilt from its first orientation.");
  v.number("returns", o.goal.returns, "m", {0, 10},
           "The run succeeds only if the object ends this near to its first place, untouched and at rest. With `tilt`, "
           "also tilted by at most 5 degrees. 0 = not asked for.");
  v.flag("both_sides", o.goal.both_sides, "`tilt` is asked for towards two opposite sides.");
  v.string("joint", o.joint, "Name of the joint that `swing` is about: a hinge, a slider or a screw.");
  v.number("swing", o.goal.swing, "rad or m", {0, 1000},
           "The run succeeds only if the coordinate of the joint rises by this much and the object is released. "
           "0 = not asked for.");
  v.number("closes", o.goal.closes, "rad or m", {0, 1000},
           "After each swing the coordinate falls to this much above its first value. 0 = not asked for.");
  v.integer("times", o.times, "1", {1, 100}, "Number of swings with `closes`.");
  v.number("skin_penetration", o.skin.penetration, "m", {0, 0.1},
           "With `hand.simulation.skin_contact` or `one_process`, a run of `softhand simulate` must pass two checks. "
           "Of the points of the skin that touch skin, 95 % are at most this deep in it. No finger passes another one, "
           "and no bone of a hand passes one of the other hand. 0 = not asked for.");
  v.number(
      "skin_friction", o.skin.friction, "1", {0, 1},
      "The same if friction of skin that slides on skin is `hand.simulation.skin_friction` times the normal force, "
      "within this fraction. 0 = not asked for.");
  v.number("soft_squeezed", o.soft.squeezed, "1", {0, 1},
           "A run of `softhand simulate` succeeds only if the least width of the first flexible object falls to this "
           "fraction of its first one. A width is the length of a line through the centre of mass, from surface to "
           "surface. Lines that leave it through an opening do not count. 0 = not asked for.");
  v.number("soft_kept", o.soft.kept, "1", {0, 1},
           "The same if this width does not fall below this fraction before the phase `squeeze`. 0 = not asked for.");
  v.number("soft_lifted", o.soft.lifted, "m", {0, 10},
           "The same if its centre of mass rises by this much. 0 = not asked for.");
  v.number("soft_recovers", o.soft.recovers, "1", {0, 1},
           "The same if its least and greatest width end within this fraction of the first ones. The hand must have "
           "let go of it. 0 = not asked for.");
  v.flag("skin_parts", o.skin.parts, "The same if no skin touches skin at the end.");
  v.number("hands_weight", o.hands.weight, "1", {0, 1},
           "With two `hands`, a run of `softhand simulate` succeeds only if both carry the lifted object. Their upward "
           "forces on it must sum to its weight, within this fraction. 0 = not asked for.");
  v.number("hands_share", o.hands.share, "1", {0, 1},
           "The same if the share of the first hand is that of the lever arms, within this much. 0 = not asked for.");
  v.number("handed_slip", o.hands.handed_slip, "m", {0, 1},
           "The same if one hand takes the object from the other, and the object moves by less than this in its palm. "
           "0 = not asked for.");
}

struct HapticOptions : DeviceOptions<HapticLogOptions> {};
inline void describe(OptionVisitor& v, HapticOptions& o) {
  describe(v, o.loop);
  describe_section(v, "log", "The simulated glove of softhand-haptic-log.", o.driver);
}
struct TactileOptions : DeviceOptions<TactileLogOptions> {};
inline void describe(OptionVisitor& v, TactileOptions& o) {
  describe(v, o.loop);
  describe_section(v, "log", "The simulated tactile glove of softhand-tactile-log.", o.driver);
}

struct SceneOptions {
  std::string name = "scene";
  std::string watch;  ///< empty = not a demonstration
  std::string plays;  ///< name of one of `Scene::hands`
  bool one_process = false;
  std::int64_t user = 0;
  std::string motion;  ///< file of a recording, or empty
  bool fit_hand = true;
  std::string calibration = "auto";
  GeneratorOptions generator;
  ReplayOptions tracker;
  TrackingOptions tracking;
  HandOptions hand;
  WorldOptions world;
  std::vector<ObjectOptions> objects;
  std::vector<JointOptions> joints;
  HapticOptions haptic;
  TactileOptions tactile;
  ViewerOptions viewer;
  FlightOptions flight;
  SimulateOptions simulate;
  JudgeOptions judge;
  Drivers drivers = registered_drivers();
};
void describe(OptionVisitor& v, SceneOptions& o);

/// The options of the driver that registered this type. Throws std::logic_error if none did.
template <typename Options>
const Options& driver_options(const SceneOptions& scene) {
  for (const auto& [section, driver] : scene.drivers)
    if (const auto* options = driver.options.template as<Options>()) return *options;
  throw std::logic_error("driver.cpp of this driver is not linked");
}

/// The file of a user's hand, as it was read.
struct Calibration {
  std::string path, text;
  UserHand hand;
};

struct Scene {
  std::string path;
  SceneOptions options;
  std::vector<AppliedOverride> overrides;
  std::vector<std::string> ignored;         ///< sections of drivers that this program does not know
  std::vector<std::string> object_folders;  ///< of the object files that the scene names
  /// The flexible ones; `options.objects` has the others. Of several hands, the first one's process simulates them all.
  std::vector<SoftObject> soft_objects;
  std::vector<std::string> hands;          ///< names of the tables `[[hands]]`. Empty: the scene has one hand
  std::optional<Calibration> calibration;  ///< of the scene's hand; not used if the hand is fitted to a recording
};

/// Reads a scene and applies `--set` assignments. A relative path in the scene is searched in the folder of the scene
/// and in the folder of its kind in config/. After these the working directory is searched. Entries of the shape
/// file are replaced by the links and joints of their files, or become soft objects. Throws ConfigError.
Scene read_scene(const std::string& path, const std::vector<std::string>& overrides = {});
/// The same for a process that a person uses: with `calibration = "auto"` it takes the person's hand, if there is one.
/// Without a person, results must not depend on the machine.
Scene read_own_scene(const std::string& path, const std::vector<std::string>& overrides);

/// The scenes of the hands that one process of a person simulates. The first one is that of `read_own_scene`. With
/// `one_process` the second one is the same scene as the other hand plays it. Throws ConfigError, also if `plays` names
/// the other hand.
std::vector<Scene> read_process_scenes(const std::string& path, const std::vector<std::string>& overrides);

/// Folders in which a process looks for the object files that descriptions name.
std::vector<std::string> object_folders(const Scene& scene);
/// The same for a text that `path` had. Files that the scene names are searched as if it had been read from `path`.
Scene read_scene_text(const std::string& path, const std::string& text, const std::vector<std::string>& overrides);

/// The motion that the scene's tracker plays: its recording, or else a generated motion. `hand` comes from
/// `load_scene_hand`.
std::shared_ptr<const Motion> make_scene_motion(const Scene& scene, const HandModel& hand);

/// The hand files among which `hand.model = "auto"` chooses, coarsest first. Joints and bones are the same in all
/// files.
inline constexpr std::array kHandSizes{"right_400.hand.json", "right_750.hand.json", "right_1450.hand.json",
                                       "right_3000.hand.json", "right_6000.hand.json"};
bool chooses_hand_size(const Scene& scene);

/// Loads the hand of the scene and mirrors it to the scene's side. If the scene plays a recording, the hand is fitted
/// to the recording's bones, otherwise to its calibration. With `hand.model = "auto"` this is the hand of 1,450 nodes:
/// results without a clock must not depend on the machine, and other processes need only the bones. Throws with file
/// and reason.
HandModel load_scene_hand(const Scene& scene);
/// The same with another hand file.
HandModel load_scene_hand(const Scene& scene, const std::string& file);
/// All hands that the scene may use: one hand, or all of `kHandSizes`.
std::vector<HandModel> load_possible_hands(const Scene& scene);

/// The hand's end of the coupling U'_crb between a mirrored object and its copy in the world. Mode symmetric has a
/// spring, mode owner has none.
ObjectSpring object_spring(const WorldOptions& world);

/// The hand of the scene: its user, and the side of its recording or else of `hand.side`.
HandKey hand_key(const Scene& scene);

/// The reference data for judging a run of this scene. `motion_start` is on the clock of the messages.
OutcomeFrame outcome_frame(const Scene& scene, Nanoseconds motion_start);

}  // namespace softhand
