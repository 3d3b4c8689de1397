// Human proportions: where the 26 joints of a naturally resting hand are, how thick it is there, what bones lie inside
// and how they may turn.
#pragma once

#include <array>

#include "model/hand_model.hpp"

namespace softhand::builder {

/// The outer measure of a hand. Metres.
struct HandSize {
  double length = 0.189;   ///< wrist to middle fingertip, [0.10, 0.26]
  double breadth = 0.085;  ///< over the heads of metacarpals II-V, [0.05, 0.13]
};

/// Joint frames and radii of a right hand at rest, in the wrist's frame (-Z to the middle finger, +Y dorsal, thumb at
/// -X).
struct RestSkeleton {
  std::array<Pose, kJointCount> joints{};
  std::array<double, kJointCount> radii{};  ///< metres, distance joint to skin
  double stump = 0.045;                     ///< z where the forearm is cut, metres
};

/// Bone lengths of Buchholz et al. 1992 (fractions of the hand's length, scaled so that skin beyond the tip joint is
/// included), joint breadths after Greiner 1991 (scaled by breadth). Relaxed: MCP 36-46, PIP 33-38, DIP 14-16 degrees
/// flexed, fingers slightly spread, thumb opposed. Throws std::invalid_argument for a size out of range.
RestSkeleton natural_rest(const HandSize& size);

/// The same natural pose with a user's bone lengths, palm and radii. `user` as `measure_skeleton` tells it, of either
/// side (`side`).
RestSkeleton natural_rest(const MeasuredSkeleton& user, Side side);

/// The 21 bodies: bones (rounded cones, at least 1 mm inside the skin), masses, joints with ranges of motion counted
/// from the rest pose, couplings.
std::array<BodyModel, kBodyCount> make_bodies(const RestSkeleton& rest);

/// Signed distance to a rounded cone: the convex hull of two spheres. Exact. Metres.
double rounded_cone_distance(const Vector3& point, const Vector3& a, const Vector3& b, double radius_a,
                             double radius_b);

}  // namespace softhand::builder
