// Human proportions of a naturally resting hand: its 26 joints, their radii, its bones and the ranges of its joints.
#pragma once

#include <array>

#include "model/hand_model.hpp"

namespace softhand::builder {

/// The outer size of a hand. Metres.
struct HandSize {
  double length = 0.189;   ///< wrist to middle fingertip, [0.10, 0.26]
  double breadth = 0.085;  ///< over the heads of metacarpals II-V, [0.05, 0.13]
};

/// Joint frames and radii of a right hand at rest, in the wrist's frame (-Z to the middle finger, +Y dorsal, thumb at
/// -X).
struct RestSkeleton {
  std::array<Pose, kJointCount> joints{};
  std::array<double, kJointCount> radii{};  ///< metres, distance joint to skin
  double stump = 0.045;                     ///< m, z of the cut through the forearm
};

/// The natural rest pose for a size. Bone lengths are those of Buchholz et al. 1992 (fractions of the hand length,
/// scaled to include the skin beyond the tip joint). Joint breadths follow Greiner 1991 (scaled by breadth). The hand
/// is relaxed: MCP 36-46, PIP 33-38, DIP 14-16 degrees flexed, fingers slightly spread, thumb opposed. Throws
/// std::invalid_argument for a size out of range.
RestSkeleton natural_rest(const HandSize& size);

/// The same natural pose with the bone lengths, palm and radii of a user. `user` is a result of `measure_skeleton`, and
/// `side` is its side.
RestSkeleton natural_rest(const MeasuredSkeleton& user, Side side);

/// The 21 bodies: bones (rounded cones, at least 1 mm inside the skin), masses, joints and couplings. The ranges of
/// motion are relative to the rest pose.
std::array<BodyModel, kBodyCount> make_bodies(const RestSkeleton& rest);

/// Signed distance to a rounded cone, the convex hull of two spheres. Exact. Metres.
double rounded_cone_distance(const Vector3& point, const Vector3& a, const Vector3& b, double radius_a,
                             double radius_b);

}  // namespace softhand::builder
