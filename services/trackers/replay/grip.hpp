// The grip of a hand on an object. It is solved for a hand and an object before the motion starts.
#pragma once

#include <vector>

#include "math/types.hpp"
#include "model/kinematics.hpp"
#include "trackers/replay/generator.hpp"

namespace softhand {

struct Grip {
  std::vector<JointAngles> apertures;     ///< from closed (first) to open (last); interpolate linearly
  double gripping = 0;                    ///< openness of the grip: 0, or more if the hand closes further in a squeeze
  Pose wrist;                             ///< world; closed, with the object in its first place
  Vector3 open_offset = Vector3::Zero();  ///< offset of the wrist when the hand is open, world
  Vector3 approach_offset;                ///< from the wrist of the open hand to the start of the approach, world
};
inline constexpr std::size_t kApertures = 17;

/// Thumb and index finger on opposite faces of a cube that stands on a table. Nothing else touches cube or table. Both
/// functions throw std::invalid_argument if the hand cannot reach the grip. The message says what it reaches.
Grip solve_pinch(const HandModel& hand, const GeneratorOptions& options);

/// All fingers around an upright cylinder in the palm, with the thumb on its other side.
Grip solve_power_grasp(const HandModel& hand, const GeneratorOptions& options);

/// The pad of the index finger on a face that looks up, the other fingers curled. There is one aperture only.
Grip solve_press(const HandModel& hand, const GeneratorOptions& options);

/// Fraction of `open_offset` at an openness. The palm leaves the object after the fingers and arrives before them.
inline double palm_back(double openness) { return minimum_jerk(2 * openness - 1); }

/// Transforms a grip to the world from the frame in which it was solved. That frame has its origin at the middle of the
/// grip, +Y up and -Z along the grip's direction. The hand approaches along -`approach`.
void place_in_world(Grip& grip, const GeneratorOptions& options, const Vector3& approach);

}  // namespace softhand
