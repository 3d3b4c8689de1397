#include "trackers/replay/generator.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "trackers/replay/free_motion.hpp"
#include "trackers/replay/grip.hpp"

namespace softhand {
namespace {

// A grip that is moved through the phases of the options: approach, close, lift, hold, shake, turn, put down, release,
// retreat.
class GraspMotion : public Motion {
 public:
  GraspMotion(const HandModel& hand, const GeneratorOptions& options)
      : hand_(hand),
        options_(options),
        grip_(options.motion == "pinch"   ? solve_pinch(hand, options)
              : options.motion == "press" ? solve_press(hand, options)
                                          : solve_power_grasp(hand, options)),
        orientation_(to_quaternion(options.orientation).normalized()) {
    double end = 0;
    const auto phase = [&](const char* name, double duration) {
      if (duration <= 0) return;
      phases_.push_back({name, end, end + duration});
      end += duration;
    };
    const GeneratorOptions& o = options;
    phase("approach", o.approach_time);
    phase("close", o.close_time);
    phase("settle", o.settle_time);
    phase("lift", o.lift_time);
    phase("hold", o.hold_time);
    phase("shake", o.shake_time);
    phase("turn", o.turn_time);
    phase("return", o.return_time);
    phase("lower", o.lower_time);
    phase("place", o.place_time);
    phase("release", o.release_time);
    phase("retreat", o.retreat_time);
    duration_ = end;
  }

  double duration() const override { return duration_; }
  std::vector<MotionPhase> phases() const override { return phases_; }
  const std::array<double, kJointCount>& radii() const override { return hand_.joint_radii; }

  JointFrames at(double time) const override {
    const GeneratorOptions& o = options_;
    const double openness = 1 - progress("close", time) + progress("release", time);
    const double away = 1 - progress("approach", time) + progress("retreat", time);
    const double height =
        o.lift_height * progress("lift", time) - (o.lift_height + o.lower_depth) * progress("lower", time);
    const Vector3 centre = to_vector(o.object_position);
    const Vector3 turn =
        o.turn_angle * (progress("turn", time) - progress("return", time)) * to_vector(o.turn_axis).normalized();
    Pose wrist = Pose{centre, rotation_exp(turn)} * Pose{grip_.wrist.position - centre, grip_.wrist.orientation};
    // In the frame of the object the hand leaves on the path on which it came.
    wrist.position += rotation_exp(turn) * (palm_back(openness) * grip_.open_offset + away * grip_.approach_offset);
    if (o.orientation != GeneratorOptions{}.orientation)
      wrist = Pose{centre, orientation_} * Pose{wrist.position - centre, wrist.orientation};
    wrist.position += height * to_vector(o.lift_axis).normalized() + shake(time);

    const double place = openness * static_cast<double>(grip_.apertures.size() - 1);
    const auto lower = std::min(static_cast<std::size_t>(std::max(place, 0.0)), grip_.apertures.size() - 2);
    const double fraction = place - static_cast<double>(lower);
    JointAngles angles;
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      angles[b] = grip_.apertures[lower][b] + fraction * (grip_.apertures[lower + 1][b] - grip_.apertures[lower][b]);
    }
    return forward_kinematics(hand_, wrist, angles);
  }

 private:
  // 0 before the phase, 1 after it.
  double progress(std::string_view name, double time) const {
    for (const MotionPhase& p : phases_) {
      if (p.name == name) return minimum_jerk((time - p.begin) / (p.end - p.begin));
    }
    return name == "approach" || name == "close" ? 1.0 : 0.0;
  }
  Vector3 shake(double time) const {
    for (const MotionPhase& p : phases_) {
      if (p.name != "shake" || time <= p.begin || time >= p.end) continue;
      // Ramps up and down over one period, so that the hand starts and ends at rest.
      const double ramp = 1 / options_.shake_frequency;
      const double window = minimum_jerk((time - p.begin) / ramp) * minimum_jerk((p.end - time) / ramp);
      return options_.shake_amplitude * window * std::sin(2 * M_PI * options_.shake_frequency * (time - p.begin)) *
             to_vector(options_.shake_axis).normalized();
    }
    return Vector3::Zero();
  }

  HandModel hand_;
  GeneratorOptions options_;
  Grip grip_;
  Quaternion orientation_;
  std::vector<MotionPhase> phases_;
  double duration_ = 0;
};

}  // namespace

void place_in_world(Grip& grip, const GeneratorOptions& o, const Vector3& approach) {
  const Pose world{to_vector(o.object_position), Quaternion(Eigen::AngleAxisd(o.yaw, Vector3::UnitY()))};
  grip.wrist = world * grip.wrist;
  grip.open_offset = world.orientation * grip.open_offset;
  grip.approach_offset = world.orientation * (o.approach_distance * approach);
}

std::unique_ptr<Motion> make_motion(const HandModel& hand, const GeneratorOptions& options) {
  if (options.motion == "pinch" && options.stagger == 0 && 2 * options.closing_depth >= options.object_width) {
    throw std::invalid_argument("generator: closing_depth: expected less than half of object_width");
  }
  if (!(std::abs(to_quaternion(options.orientation).norm() - 1) < 1e-3))
    throw std::invalid_argument("generator: orientation: expected a unit quaternion xyzw");
  for (const auto& [axis, key] :
       {std::pair{options.turn_axis, "turn_axis"}, std::pair{options.shake_axis, "shake_axis"},
        std::pair{options.lift_axis, "lift_axis"}}) {
    if (!(to_vector(axis).norm() > 1e-6))
      throw std::invalid_argument(std::string("generator: ") + key + ": expected a vector that is not zero");
  }
  if (options.motion == "pinch" || options.motion == "power_grasp" || options.motion == "press")
    return std::make_unique<GraspMotion>(hand, options);
  return make_free_motion(hand, options);
}

}  // namespace softhand
