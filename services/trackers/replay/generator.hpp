// Generated motions of a given hand: pinch or grasp an object, lift, hold, turn, put down and release it, or move
// without an object.
#pragma once

#include <memory>

#include "model/hand_model.hpp"
#include "model/kinematics.hpp"
#include "runtime/options.hpp"
#include "trackers/replay/motion.hpp"

namespace softhand {

struct GeneratorOptions {
  std::string motion = "pinch";
  std::array<double, 3> object_position{0, 0.02, 0};
  double object_width = 0.04;
  double object_length = 0;
  double free_below = 0;
  double stagger = 0;
  double body_distance = 0;
  double body_radius = 0;
  double brace_depth = 0;
  double closing_depth = 0.004;
  double squeeze_depth = 0;
  double opening = 0.02;
  double yaw = 0;
  double tilt = 0;
  std::array<double, 4> orientation{0, 0, 0, 1};
  double approach_distance = 0.12;
  std::array<double, 3> start_offset{0, 0, 0};
  std::array<double, 3> start_turn{0, 0, 0};
  double lift_height = 0.15;
  std::array<double, 3> lift_axis{0, 1, 0};
  double turn_angle = 1.0471975511965976;
  std::array<double, 3> turn_axis{0, 1, 0};
  double other_turn_angle = 0;
  std::int64_t repeats = 1;
  double ring_opening = 0;
  double lower_depth = 0.001;
  double release_height = 0;
  double approach_time = 1.0;
  double close_time = 0.8;
  double settle_time = 0.5;
  double lift_time = 1.0;
  double hold_time = 5.0;
  double shake_time = 0;
  double shake_frequency = 3;
  double shake_amplitude = 0.03;
  std::array<double, 3> shake_axis{1, 0, 0};
  double turn_time = 1.0;
  double return_time = 0;
  double lower_time = 1.0;
  double place_time = 0.5;
  double squeeze_time = 1.0;
  double release_time = 0.6;
  double retreat_time = 0.8;
  double free_time = 10;
};

inline void describe(OptionVisitor& v, GeneratorOptions& o) {
  v.choice(
      "motion", o.motion,
      {"pinch", "power_grasp", "press", "unscrew", "scissors", "fist", "rub", "clap", "interlace", "free_motion"},
      "In a pinch, thumb and index finger grip a cube on a table. In a power_grasp, all fingers grip an upright "
      "cylinder. In a press, the index finger pushes down by lower_depth. With unscrew, the pinch grips, turns, "
      "lets go and turns back, again and again. With scissors, thumb and index finger enter two rings, and open "
      "and close. A fist opens and closes the hand in the air. With rub, the thumb slides along the index finger. "
      "With clap, the palm meets that of the mirrored hand, again and again. With interlace, the fingers go between "
      "those of the mirrored hand and leave them again. A free_motion has no object.");
  v.numbers("object_position", o.object_position.data(), 3, "m", {-1000, 1000},
            "Middle of the grip in the world, or of the whole motion if there is no object.");
  v.number("object_width", o.object_width, "m", {0.002, 0.12},
           "Distance between the two gripped faces, or diameter of the cylinder.");
  v.number("object_length", o.object_length, "m", {0, 1},
           "Length of the gripped bar across the grip (pinch). 0 = a cube of object_width.");
  v.number("free_below", o.free_below, "m", {0, 1},
           "Free space between the gripped object and the table (pinch), so that fingertips can reach below a handle.");
  v.number("stagger", o.stagger, "m", {-0.1, 0.1},
           "Distance from index to thumb along the gripped bar (pinch). The two fingers then also hold a torque.");
  v.number("body_distance", o.body_distance, "m", {0, 1},
           "Distance from a handle to the axis of the vessel behind the index finger, along the handle (pinch).");
  v.number("body_radius", o.body_radius, "m", {0, 1}, "Radius of this vessel. 0 = there is none.");
  v.number("brace_depth", o.brace_depth, "m", {0, 0.02},
           "The middle finger also reaches behind the handle. Depth of its tracked back in the vessel (pinch). 0 = it "
           "stays curled.");
  v.number("closing_depth", o.closing_depth, "m", {0, 0.03},
           "Depth of each tracked pad below the surface. The coupling converts it to grip force. In a clap, the way of "
           "each tracked palm beyond the middle; with interlace, that of the middle fingertip.");
  v.number("squeeze_depth", o.squeeze_depth, "m", {0, 0.03},
           "Depth of each tracked pad in a squeeze after the object was put down (pinch). 0 = no squeeze.");
  v.number("opening", o.opening, "m", {0, 0.05}, "Distance between each open finger and the surface.");
  v.number("yaw", o.yaw, "rad", {-10, 10},
           "Direction of the grip about the vertical. 0 = from thumb to index along -Z.");
  v.number(
      "tilt", o.tilt, "rad", {-1.6, 1.6},
      "Lean of the hand about the axis of the grip, as far as clearance allows. 0 = wrist above the axis (pinch).");
  v.numbers("orientation", o.orientation.data(), 4, "1", {-1, 1},
            "Rotation of grip, approach and turn about object_position, a quaternion xyzw.");
  v.number("approach_distance", o.approach_distance, "m", {0, 1},
           "Distance at which the hand starts its approach and ends its retreat. In a clap, also the distance from the "
           "middle between two claps.");
  v.numbers("start_offset", o.start_offset.data(), 3, "m", {-1, 1},
            "Added to the place at which the hand starts and ends, in the world. The second half of the approach is "
            "the same for every start.");
  v.numbers("start_turn", o.start_turn.data(), 3, "rad", {-3.2, 3.2},
            "Rotation of the hand at its start and end about its wrist, a rotation vector in the world.");
  v.number("lift_height", o.lift_height, "m", {0, 1}, "Distance of the lift.");
  v.numbers("lift_axis", o.lift_axis.data(), 3, "1", {-1, 1},
            "Direction of the lift in the world. A horizontal one is a pull.");
  v.number("turn_angle", o.turn_angle, "rad", {-3.2, 3.2}, "Turn about the middle of the grip.");
  v.numbers("turn_axis", o.turn_axis.data(), 3, "1", {-1, 1},
            "Axis of the turn in the world. The default is upright, so that the object can be put down flat.");
  v.number("other_turn_angle", o.other_turn_angle, "rad", {-3.2, 3.2},
           "Second turn, from the first orientation, before the return. It takes twice turn_time. 0 = none.");
  v.integer("repeats", o.repeats, "1", {1, 100}, "Number of grips (unscrew), strokes (scissors) or claps.");
  v.number("ring_opening", o.ring_opening, "m", {0, 0.05},
           "Distance of each finger from the closed face while it enters and leaves its ring (scissors).");
  v.number("release_height", o.release_height, "m", {0, 1},
           "Height above its first place at which the object is released (pinch): another hand may hold it then.");
  v.number("lower_depth", o.lower_depth, "m", {0, 0.02},
           "The hand puts the object down this far below its first place, so that it sits firmly.");
  const auto time = [&v](std::string_view key, double& value, std::string_view text) {
    v.number(key, value, "s", {0, 3600}, text);
  };
  time("approach_time", o.approach_time, "Duration of the approach, fingers open.");
  time("close_time", o.close_time, "Duration of the closing.");
  time("settle_time", o.settle_time, "Pause between closing and lifting.");
  time("lift_time", o.lift_time, "Duration of the lift.");
  time("hold_time", o.hold_time, "Duration of the hold.");
  time("shake_time", o.shake_time, "Duration of the shaking after the hold. 0 = no shaking.");
  v.number("shake_frequency", o.shake_frequency, "Hz", {0.1, 20}, "Frequency of the shaking.");
  v.number("shake_amplitude", o.shake_amplitude, "m", {0, 0.2}, "Amplitude of the shaking.");
  v.numbers("shake_axis", o.shake_axis.data(), 3, "1", {-1, 1}, "Direction of the shaking in the world.");
  time("turn_time", o.turn_time, "Duration of the turn.");
  time("return_time", o.return_time, "Duration of turning back after the turn. 0 = the turn stays.");
  time("lower_time", o.lower_time, "Duration of putting down.");
  time("place_time", o.place_time, "Pause after putting down.");
  time("squeeze_time", o.squeeze_time, "Duration of the squeeze from closing_depth to squeeze_depth.");
  time("release_time", o.release_time, "Duration of the opening.");
  time("retreat_time", o.retreat_time, "Duration of the retreat.");
  time("free_time", o.free_time, "Duration of fist, rub and free_motion.");
}

/// Throws std::invalid_argument if the hand cannot reach the requested grip. The message says what it reaches.
std::unique_ptr<Motion> make_motion(const HandModel& hand, const GeneratorOptions& options);

}  // namespace softhand
