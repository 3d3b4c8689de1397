#include "trackers/replay/generator.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "math/rotation.hpp"
#include "messages/convert.hpp"
#include "trackers/replay/free_motion.hpp"
#include "trackers/replay/grip.hpp"
#include "trackers/replay/hand_to_hand.hpp"

namespace softhand {
namespace {

// A grip that is moved through the phases of the options.
class GraspMotion : public Motion {
 public:
  GraspMotion(const HandModel& hand, const GeneratorOptions& options)
      : hand_(hand),
        options_(options),
        grip_(options.motion == "power_grasp" ? solve_power_grasp(hand, options)
              : options.motion == "press"     ? solve_press(hand, options)
                                              : solve_pinch(hand, options)),
        orientation_(to_quaternion(options.orientation).normalized()),
        start_turn_(to_vector(options.start_turn)) {
    const GeneratorOptions& o = options;
    if (o.motion == "unscrew") {
      plan_unscrewing();
    } else if (o.motion == "scissors") {
      plan_strokes();
    } else {
      plan_lift();
    }
  }

  double duration() const override { return phases_.empty() ? 0 : phases_.back().end; }
  std::vector<MotionPhase> phases() const override { return phases_; }
  const std::array<double, kJointCount>& radii() const override { return hand_.joint_radii; }

  JointFrames at(double time) const override {
    const GeneratorOptions& o = options_;
    const Place place = place_at(time);
    const Vector3 centre = to_vector(o.object_position);
    const Vector3 turn = place.turn * to_vector(o.turn_axis).normalized();
    Pose wrist = Pose{centre, rotation_exp(turn)} * Pose{grip_.wrist.position - centre, grip_.wrist.orientation};
    // In the frame of the object the hand leaves on the path on which it came.
    wrist.position +=
        rotation_exp(turn) * (palm_back(place.openness) * grip_.open_offset + place.away * grip_.approach_offset);
    if (o.orientation != GeneratorOptions{}.orientation)
      wrist = Pose{centre, orientation_} * Pose{wrist.position - centre, wrist.orientation};
    wrist.position += place.height * to_vector(o.lift_axis).normalized() + shake(time);
    const double aside = minimum_jerk(2 * place.away - 1);  // gone after the first half of the approach
    wrist.position += aside * to_vector(o.start_offset);
    wrist.orientation = rotation_exp(aside * start_turn_) * wrist.orientation;

    const double aperture = place.openness * static_cast<double>(grip_.apertures.size() - 1);
    const auto lower = std::min(static_cast<std::size_t>(std::max(aperture, 0.0)), grip_.apertures.size() - 2);
    const double fraction = aperture - static_cast<double>(lower);
    JointAngles angles;
    for (std::size_t b = 0; b < kBodyCount; ++b) {
      angles[b] = grip_.apertures[lower][b] + fraction * (grip_.apertures[lower + 1][b] - grip_.apertures[lower][b]);
    }
    return forward_kinematics(hand_, wrist, angles);
  }

 private:
  // Where the hand is between two phases. It moves from one place to the next with minimum jerk.
  struct Place {
    double openness = 1;  // 0 = closed, 1 = the last aperture
    double away = 1;      // 1 = at the start of the approach, 0 = at the object
    double height = 0;    // m, along the lift's axis
    double turn = 0;      // rad
  };

  // A phase at whose end `what` has another value. A phase without a duration is part of the one before.
  void add_phase(const char* name, double duration, double Place::*what, double value) {
    add_pause(name, duration);
    places_.back().*what = value;
  }
  void add_pause(const char* name, double duration) {
    if (duration <= 0) return;
    const double begin = this->duration();
    phases_.push_back({name, begin, begin + duration});
    places_.push_back(places_.back());
  }

  // A phase without a duration does not happen.
  void plan_lift() {
    const GeneratorOptions& o = options_;
    Place first;
    if (o.approach_time <= 0) first.away = 0;
    if (o.close_time <= 0) first.openness = grip_.gripping;
    places_ = {first};
    const auto add = [this](const char* name, double duration, double Place::*what, double value) {
      if (duration > 0) add_phase(name, duration, what, value);
    };
    add("approach", o.approach_time, &Place::away, 0);
    add("close", o.close_time, &Place::openness, grip_.gripping);
    add_pause("settle", o.settle_time);
    add("lift", o.lift_time, &Place::height, o.lift_height);
    add_pause("hold", o.hold_time);
    add_pause("shake", o.shake_time);
    add("turn", o.turn_time, &Place::turn, o.turn_angle);
    if (o.other_turn_angle != 0) add("turn_other", 2 * o.turn_time, &Place::turn, o.other_turn_angle);
    add("return", o.return_time, &Place::turn, 0);
    add("lower", o.lower_time, &Place::height,
        places_.back().height - o.lift_height - o.lower_depth + o.release_height);
    add_pause("place", o.place_time);
    if (grip_.gripping > 0) add("squeeze", o.squeeze_time, &Place::openness, 0);
    add("release", o.release_time, &Place::openness, 1);
    add("retreat", o.retreat_time, &Place::away, 1);
  }

  void plan_unscrewing() {
    const GeneratorOptions& o = options_;
    places_ = {Place{}};
    add_phase("approach", o.approach_time, &Place::away, 0);
    for (std::int64_t grip = 0; grip < o.repeats; ++grip) {
      if (grip > 0) add_phase("return", o.return_time, &Place::turn, 0);
      add_phase("close", o.close_time, &Place::openness, 0);
      add_pause("settle", o.settle_time);
      add_phase("turn", o.turn_time, &Place::turn, o.turn_angle);
      add_phase("release", o.release_time, &Place::openness, 1);
    }
    add_phase("retreat", o.retreat_time, &Place::away, 1);
  }

  void plan_strokes() {
    const GeneratorOptions& o = options_;
    Place in_ring;
    in_ring.openness = o.opening > 0 ? std::min(o.ring_opening / o.opening, 1.0) : 0;
    places_ = {in_ring};
    add_phase("approach", o.approach_time, &Place::away, 0);
    for (std::int64_t stroke = 0; stroke < o.repeats; ++stroke) {
      add_phase("open", o.release_time, &Place::openness, 1);
      add_phase("close", o.close_time, &Place::openness, 0);
    }
    add_pause("settle", o.settle_time);
    add_phase("release", o.release_time, &Place::openness, in_ring.openness);
    add_phase("retreat", o.retreat_time, &Place::away, 1);
  }

  Place place_at(double time) const {
    for (std::size_t i = 0; i < phases_.size(); ++i) {
      if (time >= phases_[i].end) continue;
      const double s = minimum_jerk((time - phases_[i].begin) / (phases_[i].end - phases_[i].begin));
      const Place &from = places_[i], &to = places_[i + 1];
      return {from.openness + s * (to.openness - from.openness), from.away + s * (to.away - from.away),
              from.height + s * (to.height - from.height), from.turn + s * (to.turn - from.turn)};
    }
    return places_.back();
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
  Vector3 start_turn_;
  std::vector<MotionPhase> phases_;
  std::vector<Place> places_;  // before the first phase, then at the end of each phase
};

}  // namespace

void place_in_world(Grip& grip, const GeneratorOptions& o, const Vector3& approach) {
  const Pose world{to_vector(o.object_position), Quaternion(Eigen::AngleAxisd(o.yaw, Vector3::UnitY()))};
  grip.wrist = world * grip.wrist;
  grip.open_offset = world.orientation * grip.open_offset;
  grip.approach_offset = world.orientation * (o.approach_distance * approach);
}

std::unique_ptr<Motion> make_motion(const HandModel& hand, const GeneratorOptions& options) {
  const bool pinches = options.motion == "pinch" || options.motion == "unscrew" || options.motion == "scissors";
  for (const auto& [depth, key] :
       {std::pair{options.closing_depth, "closing_depth"}, std::pair{options.squeeze_depth, "squeeze_depth"}}) {
    if (pinches && options.stagger == 0 && 2 * depth >= options.object_width)
      throw std::invalid_argument(std::string("generator: ") + key + ": expected less than half of object_width");
  }
  if (options.squeeze_depth > 0 && options.motion != "pinch")
    throw std::invalid_argument("generator: squeeze_depth: expected 0, because only a pinch squeezes");
  if (!(std::abs(to_quaternion(options.orientation).norm() - 1) < 1e-3))
    throw std::invalid_argument("generator: orientation: expected a unit quaternion xyzw");
  for (const auto& [axis, key] :
       {std::pair{options.turn_axis, "turn_axis"}, std::pair{options.shake_axis, "shake_axis"},
        std::pair{options.lift_axis, "lift_axis"}}) {
    if (!(to_vector(axis).norm() > 1e-6))
      throw std::invalid_argument(std::string("generator: ") + key + ": expected a vector that is not zero");
  }
  if (pinches || options.motion == "power_grasp" || options.motion == "press")
    return std::make_unique<GraspMotion>(hand, options);
  if (options.motion == "clap" || options.motion == "interlace") return make_hand_to_hand(hand, options);
  return make_free_motion(hand, options);
}

}  // namespace softhand
