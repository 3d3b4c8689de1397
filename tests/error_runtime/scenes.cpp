#include "error_runtime/scenes.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "cli/outcome.hpp"
#include "cli/soft_outcome.hpp"
#include "error_runtime/trial.hpp"
#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "model/kinematics.hpp"
#include "scene_file.hpp"
#include "trackers/replay/generator.hpp"

namespace softhand::error_runtime {
namespace {

std::size_t index(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }

// A part of a motion with another duration. It is at rest at both ends.
class Paced final : public Motion {
 public:
  Paced(std::unique_ptr<Motion> motion, double from, double to, double seconds)
      : motion_(std::move(motion)), from_(from), to_(to), seconds_(seconds) {}
  double duration() const override { return seconds_; }
  const std::array<double, kJointCount>& radii() const override { return motion_->radii(); }
  JointFrames at(double time) const override {
    return motion_->at(from_ + (to_ - from_) * minimum_jerk(time / seconds_));
  }

 private:
  std::unique_ptr<Motion> motion_;
  double from_, to_, seconds_;
};

// A motion that begins at a later time of another motion.
class From final : public Motion {
 public:
  From(std::shared_ptr<const Motion> motion, double from) : motion_(std::move(motion)), from_(from) {}
  double duration() const override { return motion_->duration() - from_; }
  const std::array<double, kJointCount>& radii() const override { return motion_->radii(); }
  JointFrames at(double time) const override { return motion_->at(from_ + time); }

 private:
  std::shared_ptr<const Motion> motion_;
  double from_;
};

// Plays a motion until a time, rests there, and plays it backwards.
class ThereAndBack final : public Motion {
 public:
  ThereAndBack(std::shared_ptr<const Motion> motion, double there, double back)
      : motion_(std::move(motion)), there_(there), back_(back) {}
  double duration() const override { return back_ + there_; }
  const std::array<double, kJointCount>& radii() const override { return motion_->radii(); }
  JointFrames at(double time) const override {
    return motion_->at(time < back_ ? std::min(time, there_) : std::max(back_ + there_ - time, 0.0));
  }

 private:
  std::shared_ptr<const Motion> motion_;
  double there_, back_;
};

// One fixed posture with the wrist at the origin.
class Still final : public Motion {
 public:
  explicit Still(const HandModel& hand, const JointAngles& angles)
      : frames_(forward_kinematics(hand, Pose{}, angles)), radii_(hand.joint_radii) {}
  double duration() const override { return 0; }
  const std::array<double, kJointCount>& radii() const override { return radii_; }
  JointFrames at(double) const override { return frames_; }

 private:
  JointFrames frames_;
  std::array<double, kJointCount> radii_;
};

// Moves a motion from place to place. It is at rest at each place.
struct Waypoint {
  double time;  // s
  Vector3 place;
};
class MovedPosture final : public Motion {
 public:
  MovedPosture(std::shared_ptr<const Motion> motion, const Quaternion& orientation, std::vector<Waypoint> way)
      : motion_(std::move(motion)), orientation_(orientation), way_(std::move(way)) {}
  double duration() const override { return way_.back().time; }
  const std::array<double, kJointCount>& radii() const override { return motion_->radii(); }
  JointFrames at(double time) const override {
    Pose carrier{way_.front().place, orientation_};
    for (std::size_t k = 1; k < way_.size(); ++k) {
      carrier.position += minimum_jerk((time - way_[k - 1].time) / (way_[k].time - way_[k - 1].time)) *
                          (way_[k].place - way_[k - 1].place);
    }
    JointFrames frames = motion_->at(time);
    for (Pose& frame : frames) frame = carrier * frame;
    return frames;
  }

 private:
  std::shared_ptr<const Motion> motion_;
  Quaternion orientation_;
  std::vector<Waypoint> way_;
};

// A flat hand with the palm down, tilted until the fingertips are lowest. The tip of the middle finger follows `way`.
std::shared_ptr<const Motion> tips_down(const HandModel& hand, std::vector<Waypoint> way) {
  constexpr double kPitch = -0.7;  // rad
  auto posture = std::make_shared<Still>(hand, open_hand(hand));
  const Quaternion pitched = rotation_exp(Vector3(kPitch, 0, 0));
  const Vector3 tip = pitched * posture->at(0)[index(Joint::middle_tip)].position;
  for (Waypoint& point : way) point.place -= tip;
  return std::make_shared<MovedPosture>(posture, pitched, std::move(way));
}

ObjectOptions box(const std::string& name, const Vector3& half, const Vector3& position, double mass) {
  ObjectOptions object;
  object.name = name;
  object.half_extents = {half.x(), half.y(), half.z()};
  object.position = {position.x(), position.y(), position.z()};
  object.mass = mass;
  return object;
}

ObjectOptions table() { return box("table", {0.4, 0.02, 0.4}, {0, kFloor - 0.02, 0}, 0); }

// --- what a scene must show ----------------------------------------------------------------------

double strongest(const Trajectory& t, Finger finger) {
  double most = 0;
  for (const Sample& s : t.samples)
    most = std::max(most, to_vector(s.fingers[static_cast<std::size_t>(finger)].force).norm());
  return most;
}

std::string must(bool holds, const std::string& otherwise) { return holds ? "" : otherwise + "; "; }

std::string touches(const Trajectory& t, std::initializer_list<Finger> fingers, double newtons) {
  std::string text;
  for (const Finger f : fingers) {
    text += must(strongest(t, f) >= newtons,
                 fmt::format("{} presses with at most {:.2f} N, expected at least {} N",
                             kFingerNames[static_cast<std::size_t>(f)], strongest(t, f), newtons));
  }
  return text;
}

std::string touches_nothing(const Trajectory& t) {
  std::string text;
  for (const Finger f : {Finger::thumb, Finger::index, Finger::middle, Finger::ring, Finger::little, Finger::palm}) {
    text += must(strongest(t, f) == 0, fmt::format("{} touches something", kFingerNames[static_cast<std::size_t>(f)]));
  }
  return text;
}

double travel(const Trajectory& t, Joint joint) {
  return (t.samples.back().joints[index(joint)].position - t.samples.front().joints[index(joint)].position).norm();
}

double rise(const Trajectory& t, std::size_t object) {
  return t.samples.back().objects[object].position.y() - t.samples.front().objects[object].position.y();
}

// Largest sliding distance of a finger's contact, m.
double slid(const Trajectory& t) {
  double farthest = 0;
  for (std::size_t f = 0; f < 5; ++f) {
    double sum = 0;
    for (std::size_t k = 1; k < t.samples.size(); ++k) {
      sum += t.samples[k].fingers[f].slip_speed * static_cast<double>(t.samples[k].tick - t.samples[k - 1].tick) /
             static_cast<double>(kTicksPerSecond);
    }
    farthest = std::max(farthest, sum);
  }
  return farthest;
}

std::size_t most_touching(const Trajectory& t) {
  std::size_t most = 0;
  for (const Sample& s : t.samples)
    most = std::max(
        most, static_cast<std::size_t>(std::count_if(s.touch.begin(), s.touch.end(), [](auto x) { return x != 0; })));
  return most;
}

// Angle (degrees) by which the middle finger's last bone has turned at `time` since the start, relative to the wrist.
double bent(const Trajectory& t, double time) {
  const auto direction = [](const Sample& s) -> Vector3 {
    return s.joints[index(Joint::wrist)].orientation.conjugate() *
           (s.joints[index(Joint::middle_distal)].orientation * -Vector3::UnitZ());
  };
  const auto then = std::find_if(t.samples.begin(), t.samples.end(), [time](const Sample& s) {
    return static_cast<double>(s.tick) >= time * static_cast<double>(kTicksPerSecond);
  });
  const double cosine = direction(t.samples.front()).dot(direction(then == t.samples.end() ? t.samples.back() : *then));
  return std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / M_PI;
}

std::string is_a_fist(const Trajectory& t, double time) {
  return must(
      bent(t, time) > 90,
      fmt::format("the middle finger's last bone turns by {:.0f} degrees, expected more than 90", bent(t, time)));
}

// Whether the scene's only flexible object is squeezed and gets its shape back. Its widths are those of
// `softhand simulate`.
std::string squeezes(const Trajectory& t, const SoftObject& object) {
  SoftOutcome outcome(*object.body);
  for (const Sample& s : t.samples) {
    SoftObjectState state;
    state.object = kFirstSoftObject;
    const Vector3 centre = s.soft.rowwise().mean();
    for (const auto& node : s.soft.colwise()) state.nodes.push_back(to_floats(node - centre));
    outcome.on_state(state);
  }
  const nlohmann::ordered_json summary = outcome.summary({}, {});
  const double squeezed = 100 * summary["squeezed_to_fraction"].get<double>(),
               off = 100 * summary["end_off_fraction"].get<double>();
  return must(squeezed < 55,
              fmt::format("{} is squeezed to {:.0f} % of its width, expected less than 55 %", object.name, squeezed)) +
         must(off < 2, fmt::format("it ends {:.1f} % off its first width, expected less than 2 %", off)) +
         must(t.samples.back().skin_contacts == 0, "the hand touches it at the end");
}

// --- the scenes ----------------------------------------------------------------------------------

GeneratorOptions grasp_of(const std::string& motion, double width, double height) {
  GeneratorOptions o;
  o.motion = motion;
  o.object_width = width;
  o.object_position = {0, height, 0};
  o.opening = 0.008;
  o.approach_time = 0;
  o.close_time = 0.35;
  o.settle_time = 0.05;
  o.lift_time = 0.4;
  o.lift_height = 0.03;
  o.hold_time = 0.5;
  return o;
}

Scene free_motion() {
  Scene scene{"free_motion", "the wrist and every finger move, no object is near", 1, {}, {}, false, {}, {}};
  scene.motion = [](const HandModel& hand) {
    GeneratorOptions o;
    o.motion = "free_motion";
    return std::make_shared<Paced>(make_motion(hand, o), 1.5, 3.0, 1.0);
  };
  scene.missing = [](const Trajectory& t) {
    return must(travel(t, Joint::wrist) > 0.03 && travel(t, Joint::index_tip) > 0.03, "the hand hardly moves") +
           touches_nothing(t);
  };
  return scene;
}

constexpr double kFistClosed = 0.9, kFistOpens = 1.0;  // s

Scene fist() {
  Scene scene{"fist", "the open hand closes to a fist and opens again", 2, {}, {}, false, {}, {}};
  scene.motion = [](const HandModel& hand) {
    GeneratorOptions o;
    o.motion = "fist";
    return std::make_shared<ThereAndBack>(std::make_shared<Paced>(make_motion(hand, o), 0.5, 2.0, kFistClosed),
                                          kFistClosed, kFistOpens);
  };
  scene.missing = [](const Trajectory& t) {
    return is_a_fist(t, kFistOpens) +
           must(bent(t, 2) < 10,
                fmt::format("the finger stays bent by {:.0f} degrees, expected less than 10", bent(t, 2))) +
           touches_nothing(t);
  };
  return scene;
}

Scene pinch_lift() {
  Scene scene{"pinch_lift",
              "thumb and index take a 50 g cube of 40 mm from a table and lift it by 30 mm",
              1,
              {table(), box("cube", Vector3::Constant(0.02), {0, 0.02, 0}, 0.05)},
              {},
              true,
              {},
              {}};
  scene.live = {0.01, 0.01};
  scene.motion = [](const HandModel& hand) { return make_motion(hand, grasp_of("pinch", 0.04, 0.026)); };
  scene.missing = [](const Trajectory& t) {
    return touches(t, {Finger::thumb, Finger::index}, 0.3) +
           must(rise(t, 1) > 0.02,
                fmt::format("the cube rises by {:.1f} mm, expected more than 20 mm", 1e3 * rise(t, 1)));
  };
  return scene;
}

// Like config/scenes/power_grasp.toml, but faster and with a shorter approach.
Scene power_grasp() {
  ObjectOptions cylinder = box("cylinder", Vector3::Zero(), {0, 0.06, 0}, 0.2);
  cylinder.shape = "cylinder";
  cylinder.radius = 0.025;
  cylinder.half_length = 0.06;
  Scene scene{"power_grasp",
              "all fingers close around an upright cylinder of 200 g and 50 mm and lift it by 30 mm",
              1,
              {table(), cylinder},
              {},
              true,
              {},
              {}};
  scene.live = {0.1, 0.05};
  scene.motion = [](const HandModel& hand) { return make_motion(hand, grasp_of("power_grasp", 0.05, 0.06)); };
  scene.missing = [](const Trajectory& t) {
    return touches(t, {Finger::thumb, Finger::index, Finger::middle, Finger::ring, Finger::little}, 0.3) +
           must(rise(t, 1) > 0.02,
                fmt::format("the cylinder rises by {:.1f} mm, expected more than 20 mm", 1e3 * rise(t, 1)));
  };
  return scene;
}

Scene table_slide() {
  Scene scene{"table_slide", "the fingertips touch a table and slide back by 50 mm", 1, {table()}, {}, false, {}, {}};
  scene.motion = [](const HandModel& hand) {
    return tips_down(hand, {{0, {0, 0.012, 0}}, {0.3, {0, -0.001, 0}}, {0.9, {0, -0.001, 0.05}}});
  };
  scene.missing = [](const Trajectory& t) {
    return touches(t, {Finger::middle, Finger::ring}, 0.5) +
           must(slid(t) > 0.03,
                fmt::format("the contacts slide by {:.1f} mm, expected more than 30 mm", 1e3 * slid(t)));
  };
  return scene;
}

Scene deep_block() {
  Scene scene{"deep_block",
              "the tracked fingers go 40 mm into an 80 mm block that does not move",
              1,
              {box("block", Vector3::Constant(0.04), {0, -0.04, 0}, 0)},
              {},
              false,
              {},
              {}};
  scene.motion = [](const HandModel& hand) {
    auto flat = std::make_shared<Still>(hand, open_hand(hand));
    const Vector3 over = flat->at(0)[index(Joint::middle_intermediate)].position;
    return std::make_shared<MovedPosture>(
        flat, Quaternion::Identity(),
        std::vector<Waypoint>{{0, Vector3(0, 0.015, 0) - over}, {0.6, Vector3(0, -0.04, 0) - over}});
  };
  scene.missing = [](const Trajectory& t) {
    return touches(t, {Finger::index, Finger::middle, Finger::ring}, 3) +
           must(most_touching(t) >= 20, fmt::format("{} nodes touch, expected at least 20", most_touching(t)));
  };
  return scene;
}

// Five cubes stand in the fingers' way. The other cubes stand far away.
Scene clutter() {
  Scene scene{"clutter_100",
              "four fingers push some of 100 cubes over a table",
              1,
              {table()},
              {"mirrored_objects=5"},
              false,
              {},
              {}};
  const Vector3 half = Vector3::Constant(0.011);
  for (int k = 0; k < 5; ++k)
    scene.objects.push_back(box(fmt::format("near_{}", k), half, {-0.048 + 0.024 * k, half.y(), -0.028}, 0.02));
  for (int k = 0; k < 95; ++k)
    scene.objects.push_back(
        box(fmt::format("far_{}", k), half, {-0.36 + 0.04 * (k % 19), half.y(), -0.2 - 0.04 * (k / 19)}, 0.02));
  scene.motion = [](const HandModel& hand) { return tips_down(hand, {{0, {0, 0.011, 0}}, {0.9, {0, 0.011, -0.065}}}); };
  scene.missing = [](const Trajectory& t) {
    int moved = 0, stayed = 0;
    for (std::size_t o = 1; o < t.samples.back().objects.size(); ++o) {
      const double way = (t.samples.back().objects[o].position - t.samples.front().objects[o].position).norm();
      (way > 5e-3 ? moved : stayed) += 1;
    }
    return must(moved >= 3, fmt::format("{} cubes are pushed, expected at least 3", moved)) +
           must(moved + stayed == 100, "the scene does not have 100 cubes");
  };
  return scene;
}

// Like config/scenes/sponge.toml, but faster and without an approach. It ends soon after the hand has let go, because a
// ball that rolls on its triangles shows errors of the release only.
Scene flexible_ball() {
  const softhand::Scene file = read_scene(
      SOFTHAND_SOURCE_DIR "/config/scenes/sponge.toml",
      {"generator.opening=0.008", "generator.approach_time=0", "generator.close_time=0.4", "generator.settle_time=0.05",
       "generator.hold_time=0.25", "generator.place_time=0", "generator.release_time=0.3", "generator.retreat_time=0"});
  Scene scene{"flexible_ball",
              "thumb and index squeeze a 50 mm ball of foam to about half its width, and let it go",
              1,
              file.options.objects,
              {},
              true,
              {},
              {}};
  scene.soft_objects = file.soft_objects;
  // On its flattest place. A ball of triangles that starts on another place is still rolling when the hand touches it,
  // and its way then depends on rounding.
  scene.soft_objects.front().pose = {Vector3(0, 0.0249, 0), rotation_exp(Vector3(0, 0, -0.151))};
  scene.motion = [file](const HandModel& hand) { return make_scene_motion(file, hand); };
  scene.missing = [file](const Trajectory& t) {
    return touches(t, {Finger::thumb, Finger::index}, 0.3) + squeezes(t, file.soft_objects.front());
  };
  return scene;
}

constexpr double kRecordedFist = 0.9;  // s of the recording, at which the hand begins to close

// A part of config/scenes/fist.toml with a recording: the hand closes to a fist.
Scene fist_recorded(const std::string& recording) {
  const softhand::Scene file = read_scene(SOFTHAND_SOURCE_DIR "/config/scenes/fist.toml", {"motion=" + recording});
  Scene scene{"fist_recorded",
              "a recorded hand closes to a fist, and its skin touches itself",
              1.5,
              {},
              {"simulation.skin_contact=true"},
              false,
              {},
              {}};
  scene.fitted_hand = [file](const std::string& hand) { return load_scene_hand(file, hand); };
  scene.motion = [file](const HandModel& hand) {
    return std::make_shared<From>(make_scene_motion(file, hand), kRecordedFist);
  };
  scene.missing = [](const Trajectory& t) {
    std::size_t most = 0;
    for (const Sample& s : t.samples) most = std::max(most, s.skin_contacts);
    return is_a_fist(t, 1.5) +
           must(most >= 3, fmt::format("{} points of the skin touch the skin, expected at least 3", most)) +
           touches_nothing(t);
  };
  return scene;
}

// A part of config/scenes/recorded_grasp.toml: the fist closes around the cylinder.
Scene recorded_grasp(const std::string& recording) {
  const softhand::Scene file =
      read_scene(SOFTHAND_SOURCE_DIR "/config/scenes/recorded_grasp.toml", {"motion=" + recording});
  Scene scene{"recorded_grasp",
              "a recorded fist closes around a cylinder of 30 g and 24 mm",
              1.5,
              file.options.objects,
              {},
              false,
              {},
              {}};
  scene.live = {0.3, {}};
  scene.fitted_hand = [file](const std::string& hand) { return load_scene_hand(file, hand); };
  scene.motion = [file](const HandModel& hand) {
    return std::make_shared<From>(make_scene_motion(file, hand), kRecordedFist);
  };
  scene.missing = [](const Trajectory& t) {
    const double away =
        (t.samples.back().objects[0].position - t.samples.back().joints[index(Joint::middle_proximal)].position).norm();
    return touches(t, {Finger::index, Finger::middle, Finger::ring}, 0.3) +
           must(away < 0.08, fmt::format("the cylinder is {:.0f} mm from the fist, expected 80", 1e3 * away));
  };
  return scene;
}

}  // namespace

std::vector<Scene> all_scenes(const std::string& recording) {
  std::vector<Scene> scenes{free_motion(), fist(),       pinch_lift(), power_grasp(),
                            table_slide(), deep_block(), clutter(),    flexible_ball()};
  if (!recording.empty()) {
    scenes.push_back(recorded_grasp(recording));
    scenes.push_back(fist_recorded(recording));
  }
  return scenes;
}

std::vector<NotBuilt> scenes_not_built(const std::string& recording) {
  if (!recording.empty()) return {};
  const char* reason = "the recording is not in the repository; give it with --motion";
  return {{"recorded_grasp", reason}, {"fist_recorded", reason}};
}

}  // namespace softhand::error_runtime
