// How a hand takes an object: solved for a hand and an object before the motion starts.
#pragma once

#include <vector>

#include "math/types.hpp"
#include "trackers/replay/generator.hpp"
#include "trackers/replay/kinematics.hpp"

namespace softhand {

struct Grip {
  std::vector<JointAngles> apertures;     ///< from closed (first) to open (last), linear in between
  Pose wrist;                             ///< world, at the object in its first place, closed
  Vector3 open_offset = Vector3::Zero();  ///< of the wrist when the hand is open, world
  Vector3 approach_offset;                ///< from the open hand's wrist to where the hand comes from, world
};
inline constexpr std::size_t kApertures = 17;

/// Thumb against index on opposite faces of a cube that stands on a table, nothing else touching cube or table. Both
/// throw std::invalid_argument where the hand cannot reach the grip: the message gives what it reaches.
Grip solve_pinch(const HandModel& hand, const GeneratorOptions& options);

/// All fingers around an upright cylinder in the palm, the thumb on its other side.
Grip solve_power_grasp(const HandModel& hand, const GeneratorOptions& options);

/// Share of `open_offset` at an openness: the palm leaves the object after the fingers, and comes to it before them.
inline double palm_back(double openness) { return minimum_jerk(2 * openness - 1); }

/// From the frame in which grips are solved (origin at the grip's middle, +Y up, -Z along the grip's direction) to the
/// world; the hand comes along -`approach`.
void place_in_world(Grip& grip, const GeneratorOptions& options, const Vector3& approach);

}  // namespace softhand
