#include "scene_file.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <tuple>

#include "contact/skin_patches.hpp"
#include "runtime/object_store.hpp"
#include "trackers/replay/recording.hpp"
#include "world/solid.hpp"

namespace softhand {
namespace {

namespace fs = std::filesystem;

// Where a scene finds its files, in search order. The shipped folder comes last, so that it replaces no file of the
// user.
std::vector<fs::path> search_folders(const Scene& scene, const char* kind) {
  const fs::path beside = fs::path(scene.path).parent_path();
  return {beside, beside / ".." / kind, ".", fs::path(SOFTHAND_CONFIG_DIR) / kind};
}

std::string find_file(const Scene& scene, const std::string& name, const char* kind) {
  std::string searched;
  for (const fs::path& folder : search_folders(scene, kind)) {
    const fs::path candidate = folder / name;
    if (fs::exists(candidate) && !fs::is_directory(candidate)) return candidate.lexically_normal().string();
    searched += (searched.empty() ? "" : ", ") + fs::absolute(folder / ".").lexically_normal().string();
  }
  throw ConfigError(scene.path + ": no file '" + name + "' in any of these folders: " + searched);
}

// A file that the scene names belongs to the configuration.
template <typename Load>
auto checked(Load&& load) {
  try {
    return load();
  } catch (const std::runtime_error& problem) {
    throw ConfigError(problem.what());
  }
}

std::optional<Recording> load_recording(const Scene& scene) {
  if (scene.options.motion.empty()) return std::nullopt;
  return checked([&] { return Recording::load(find_file(scene, scene.options.motion, "motions")); });
}

Calibration load_calibration(const std::string& path) {
  Calibration calibration{path, config_detail::read_whole_file(path), {}};
  calibration.hand = read_user_hand(calibration.text, path);
  return calibration;
}

// In a wrist frame with -Z forward and +Y dorsal, the thumb of a right hand lies at -X.
Side side_of(const Recording& recording) {
  const JointFrames& frame = recording.frames().front();
  const Pose& wrist = frame[static_cast<std::size_t>(index_of(Joint::wrist))];
  const Vector3 thumb = wrist.inverse() * frame[static_cast<std::size_t>(index_of(Joint::thumb_proximal))].position;
  const Vector3 little = wrist.inverse() * frame[static_cast<std::size_t>(index_of(Joint::little_proximal))].position;
  return thumb.x() < little.x() ? Side::right : Side::left;
}

Side scene_side(const Scene& scene, const std::optional<Recording>& recording) {
  if (recording) return side_of(*recording);
  return scene.options.hand.side == "left" ? Side::left : Side::right;
}

LoadedObject load_scene_object(const Scene& scene, const ObjectOptions& entry) {
  const std::string where = scene.path + ": objects." + entry.name + ".file: ";
  if (entry.file.empty()) throw ConfigError(where + "expected a name in config/objects, or a path");
  const bool has_suffix = entry.file.ends_with(kObjectSuffix);
  const std::string path =
      find_file(scene, has_suffix ? entry.file : entry.file + std::string(kObjectSuffix), "objects");
  try {
    LoadedObject object = load_object(path);
    // Other processes find the file by the name of the object.
    if (fs::path(path).filename() != object.model.name + std::string(kObjectSuffix))
      throw std::runtime_error(path + ": the object's name is '" + object.model.name + "'; expected the file name '" +
                               object.model.name + std::string(kObjectSuffix) + "'");
    return object;
  } catch (const std::runtime_error& problem) {
    throw ConfigError(where + problem.what());
  }
}

SoftObject soft_object(const Scene& scene, const ObjectOptions& entry, LoadedObject&& loaded) {
  const auto refuse = [&](const char* field, const char* expected) {
    throw ConfigError(scene.path + ": objects." + entry.name + "." + field + ": the object is flexible; expected " +
                      expected);
  };
  if (entry.mass != 0) refuse("mass", "0, because the object file has a density");
  if (entry.fixed) refuse("fixed", "false");
  if (entry.floating) refuse("floating", "false");
  const auto &p = entry.position, &g = scene.options.world.gravity;
  const auto& q = entry.orientation;
  const Quaternion orientation(q[3], q[0], q[1], q[2]);
  if (!(std::abs(orientation.norm() - 1) < 1e-3)) refuse("orientation", "a unit quaternion xyzw");
  return {entry.name,
          std::make_shared<const SoftBody>(std::move(*loaded.model.soft)),
          {{p[0], p[1], p[2]}, orientation.normalized()},
          {g[0], g[1], g[2]},
          scene.options.world.soft == "world",
          scene.options.hand.simulation.contact_stiffness,
          loaded.model.name,
          loaded.sha256};
}

// Replaces entries of the shape file by the links and joints of their files. Flexible objects become `soft_objects`.
void add_object_files(Scene& scene) {
  std::vector<ObjectOptions> objects;
  for (const ObjectOptions& entry : scene.options.objects) {
    if (entry.shape != "file") {
      objects.push_back(entry);
      continue;
    }
    LoadedObject loaded = load_scene_object(scene, entry);
    scene.object_folders.push_back(fs::path(loaded.path).parent_path().string());
    if (loaded.model.soft) {
      if (scene.soft_objects.size() == kMaxSoftObjects)
        throw ConfigError(scene.path + ": objects." + entry.name + ": expected at most " +
                          std::to_string(kMaxSoftObjects) + " flexible objects");
      for (const SoftObject& other : scene.soft_objects)
        if (other.name == entry.name)
          throw ConfigError(scene.path + ": objects." + entry.name + ": the name is used twice");
      scene.soft_objects.push_back(soft_object(scene, entry, std::move(loaded)));
      continue;
    }
    try {
      add_file_objects(entry, std::make_shared<const ObjectModel>(std::move(loaded.model)), loaded.sha256, objects,
                       scene.options.joints);
    } catch (const std::invalid_argument& problem) {
      throw ConfigError(scene.path + ": " + problem.what());
    }
  }
  scene.options.objects = std::move(objects);
}

const ObjectOptions* judged_object(const SceneOptions& options) {
  for (const ObjectOptions& object : options.objects) {
    if (options.judge.object.empty() ? object.mass > 0 : object.name == options.judge.object) return &object;
  }
  return nullptr;
}

const JointOptions* judged_joint(const SceneOptions& options) {
  for (const JointOptions& joint : options.joints) {
    if (joint.name == options.judge.joint) return &joint;
  }
  return nullptr;
}

JudgedJoint judged(const SceneOptions& options, const JointOptions& joint) {
  JudgedJoint out;
  out.law = joint_law(joint);
  const auto id = [&options](const std::string& name) {
    const auto found = std::find_if(options.objects.begin(), options.objects.end(),
                                    [&name](const ObjectOptions& object) { return object.name == name; });
    return static_cast<std::uint32_t>(found - options.objects.begin()) + 1;
  };
  out.parent = id(joint.parent);
  out.child = id(joint.child);
  const ObjectOptions &parent = options.objects.at(out.parent - 1), &child = options.objects.at(out.child - 1);
  std::tie(out.parent_from_joint, out.child_from_joint) =
      joint_frames(joint, parent, make_solid(parent), child, make_solid(child));
  return out;
}

}  // namespace

void describe(OptionVisitor& v, SceneOptions& o) {
  v.string("name", o.name, "Name of the scene.");
  v.string("watch", o.watch,
           "One line on what to watch. `softhand demo` lists the scenes of config/scenes that have this key.");
  v.string(
      "plays", o.plays,
      "Name of the table `[[hands]]` whose hand this process simulates. A scene with several hands has such tables. "
      "Each has a `name`, and keys of the scene that replace the scene's own, for example `hands.generator`. "
      "Empty = the first.");
  v.flag("one_process", o.one_process,
         "One process simulates both hands of `[[hands]]`, so their skins touch each other (docs/two-hands.md). The "
         "options of the first hand's process hold for both.");
  v.integer("user", o.user, "1", {0, 15}, "User of the hand. It is part of the key of every topic about a hand.");
  v.string("motion", o.motion,
           "Recorded motion that the replay tracker plays: CSV of WebXR joint poses, columns in "
           "services/trackers/replay/recording.hpp. Empty = use the generator.");
  v.flag("fit_hand", o.fit_hand,
         "With a recorded motion, scale the hand to the bone lengths and thickness of the recording.");
  v.string("calibration", o.calibration,
           "The user's hand, to which the simulated hand is fitted: auto, none, or a file of `softhand calibrate` "
           "(docs/calibration.md). With auto, the processes of a rig take the user's file if there is one. `softhand "
           "simulate` then takes none. Not used if the hand is fitted to a recording.");
  describe_section(v, "generator", "A generated motion.", o.generator);
  describe_section(v, "tracker", "How the replay tracker delivers the motion.", o.tracker);
  for (auto& [section, driver] : o.drivers)
    describe_section(v, section, driver_program(section) + ": " + driver.about, driver.options);
  describe_section(v, "tracking", "The intermediate layer.", o.tracking);
  describe_section(v, "hand", "The hand simulation.", o.hand);
  describe_section(v, "world", "The physics engine's world.", o.world);
  describe_list(v, "objects", "An object of the world.", o.objects);
  describe_list(v, "joints", "A joint between two objects (docs/articulated-objects.md).", o.joints);
  describe_section(v, "haptic", "Haptic devices.", o.haptic);
  describe_section(v, "tactile", "Tactile devices.", o.tactile);
  describe_section(v, "viewer", "The browser viewer.", o.viewer);
  describe_section(v, "flight", "The flight recorder (docs/flight-recorder.md).", o.flight);
  describe_section(v, "simulate", "`softhand simulate`.", o.simulate);
  describe_section(v, "judge", "How a run is judged.", o.judge);
}

Scene read_scene(const std::string& path, const std::vector<std::string>& overrides) {
  return read_scene_text(path, config_detail::read_whole_file(path), overrides);
}

Scene read_scene_text(const std::string& path, const std::string& text, const std::vector<std::string>& overrides) {
  Scene scene;
  scene.path = path;
  const auto is_foreign = [&scene](std::string_view key) {
    if (!is_driver_section(key) || scene.options.drivers.contains(std::string(key))) return false;
    scene.ignored.emplace_back(key);
    return true;
  };
  Variants hands;
  hands.list = "hands";
  constexpr std::string_view kPlays = "plays=";
  for (const std::string& assignment : overrides)
    if (assignment.starts_with(kPlays)) hands.chosen = assignment.substr(kPlays.size());
  read_toml_text(scene.options, text, path, is_foreign, &hands);
  scene.options.plays = hands.chosen;
  scene.hands = hands.names;
  if (scene.hands.size() > 1) scene.options.hand.simulation.other_hands = true;
  for (const std::string& assignment : overrides) {
    if (is_foreign(std::string_view(assignment).substr(0, assignment.find_first_of(".=")))) continue;
    scene.overrides.push_back(apply_override(scene.options, assignment));
  }
  if (scene.options.one_process) {
    if (scene.hands.size() != kMostHands)
      throw ConfigError(path + ": one_process: the scene has " + std::to_string(scene.hands.size()) +
                        " tables [[hands]], expected " + std::to_string(kMostHands));
    scene.options.hand.simulation.other_hands = false;
  }
  add_object_files(scene);
  // One process simulates the flexible objects: that of the first hand.
  if (!scene.hands.empty() && !hands.chosen.empty() && hands.chosen != scene.hands.front()) scene.soft_objects.clear();
  if (!scene.options.judge.object.empty() && judged_object(scene.options) == nullptr) {
    throw ConfigError(path + ": judge.object: no object has the name '" + scene.options.judge.object + "'");
  }
  if (const std::string& joint = scene.options.judge.joint; !joint.empty()) {
    const JointOptions* judged = judged_joint(scene.options);
    if (judged == nullptr) throw ConfigError(path + ": judge.joint: no joint has the name '" + joint + "'");
    if (!joint_law(*judged).has_coordinate())
      throw ConfigError(path + ": judge.joint: '" + joint + "' is " + judged->kind +
                        "; expected a joint with one coordinate");
  } else if (scene.options.judge.goal.swing > 0) {
    throw ConfigError(path + ": judge.swing: expected the name of a joint in judge.joint");
  }
  // Never more slots than the scene has objects, if it lists any. A slot for a movable object adds columns to the
  // matrix of the step even if it is unused.
  const auto& objects = scene.options.objects;
  if (!objects.empty() || !scene.soft_objects.empty()) {
    const auto movable = static_cast<std::int64_t>(
        std::count_if(objects.begin(), objects.end(), [](const ObjectOptions& o) { return o.mass > 0; }));
    HandOptions& hand = scene.options.hand;
    hand.mirrored_objects = std::min(hand.mirrored_objects, movable);
    hand.static_objects = std::min(hand.static_objects, static_cast<std::int64_t>(objects.size()) - movable);
    hand.object_joints = std::min(hand.object_joints, static_cast<std::int64_t>(scene.options.joints.size()));
  }
  const std::string& calibration = scene.options.calibration;
  if (calibration != "auto" && calibration != "none")
    scene.calibration = load_calibration(find_file(scene, calibration, "users"));
  return scene;
}

Scene read_own_scene(const std::string& path, const std::vector<std::string>& overrides) {
  Scene scene = read_scene(path, overrides);
  if (scene.options.calibration != "auto") return scene;
  const fs::path file = user_hand_path(hand_key(scene));
  if (!file.empty() && fs::exists(file)) scene.calibration = load_calibration(file.string());
  return scene;
}

std::vector<Scene> read_process_scenes(const std::string& path, const std::vector<std::string>& overrides) {
  std::vector<Scene> scenes{read_own_scene(path, overrides)};
  if (!scenes[0].options.one_process) return scenes;
  const std::vector<std::string>& names = scenes[0].hands;
  const std::string& plays = scenes[0].options.plays;
  if (!plays.empty() && plays != names[0])
    throw ConfigError(path + ": plays: one_process is true, so the process of '" + names[0] + "' simulates '" + plays +
                      "' too");
  std::vector<std::string> of_other = overrides;
  of_other.push_back("plays=" + names[1]);
  scenes.push_back(read_own_scene(path, of_other));
  return scenes;
}

std::vector<std::string> object_folders(const Scene& scene) {
  std::vector<std::string> folders = scene.object_folders;
  for (const fs::path& folder : search_folders(scene, "objects")) folders.push_back(folder.lexically_normal().string());
  return folders;
}

std::shared_ptr<const Motion> make_scene_motion(const Scene& scene, const HandModel& hand) {
  if (auto recording = load_recording(scene)) return std::make_shared<Recording>(std::move(*recording));
  return make_motion(hand, scene.options.generator);
}

bool chooses_hand_size(const Scene& scene) { return scene.options.hand.model == "auto"; }

HandModel load_scene_hand(const Scene& scene) {
  return load_scene_hand(scene, chooses_hand_size(scene) ? "right_1450.hand.json" : scene.options.hand.model);
}

std::vector<HandModel> load_possible_hands(const Scene& scene) {
  std::vector<HandModel> hands;
  if (!chooses_hand_size(scene)) {
    hands.push_back(load_scene_hand(scene));
  } else {
    for (const char* file : kHandSizes) hands.push_back(load_scene_hand(scene, file));
  }
  return hands;
}

HandModel load_scene_hand(const Scene& scene, const std::string& file) {
  HandModel hand = checked([&] { return load_hand(find_file(scene, file, "hands")); });
  const auto recording = load_recording(scene);
  const Side side = scene_side(scene, recording);
  if (hand.side != side) hand = mirrored(hand);
  if (recording && scene.options.fit_hand)
    return fitted(hand, measure_skeleton(recording->frames(), recording->radii()));
  if (!scene.calibration) return hand;
  try {
    return fitted(hand, scene.calibration->hand);
  } catch (const std::invalid_argument& problem) {
    throw ConfigError(scene.calibration->path + ": " + problem.what() +
                      "; calibrate again, or set calibration = \"none\"");
  }
}

ObjectSpring object_spring(const WorldOptions& world) {
  if (world.mode != "symmetric") return {};
  return {world.stiffness, world.angular_stiffness, world.damping_ratio};
}

HandKey hand_key(const Scene& scene) {
  return {static_cast<std::uint32_t>(scene.options.user),
          scene_side(scene, load_recording(scene)) == Side::left ? 0u : 1u};
}

OutcomeFrame outcome_frame(const Scene& scene, Nanoseconds motion_start) {
  OutcomeFrame frame;
  frame.motion_start = motion_start;
  frame.goal = scene.options.judge.goal;
  frame.goal.times = static_cast<int>(scene.options.judge.times);
  if (const JointOptions* joint = judged_joint(scene.options)) frame.joint = judged(scene.options, *joint);
  frame.recorded = !scene.options.motion.empty();
  frame.shake_frequency = scene.options.generator.shake_time > 0 ? scene.options.generator.shake_frequency : 0;
  if (!frame.recorded) frame.phases = make_scene_motion(scene, load_scene_hand(scene))->phases();
  if (const ObjectOptions* object = judged_object(scene.options)) {
    // The world numbers its objects from 1 in the order of the scene.
    frame.object = static_cast<std::uint32_t>(object - scene.options.objects.data()) + 1;
    frame.object_mass = object->mass;
  }
  return frame;
}

}  // namespace softhand
