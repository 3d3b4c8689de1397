// Converts 21 landmarks of a hand to the 26 joints of a hand with given bones.
#pragma once

#include <array>
#include <optional>

#include "messages/messages.hpp"
#include "model/hand_model.hpp"

namespace softhand {

inline constexpr std::size_t kLandmarkCount = 21;
/// Wrist; thumb: metacarpal, proximal, distal, tip; each finger: proximal, intermediate, distal, tip. This is
/// MediaPipe's order.
using Landmarks = std::array<Vector3, kLandmarkCount>;

/// The joint at landmark `index`.
Joint joint_of_landmark(std::size_t index);

/// The places of a hand's bones that some skeletons have: the wrist, and for each finger the joints proximal,
/// intermediate and distal, for the thumb metacarpal, proximal and distal. Poses in one frame. The axes of the bones
/// may be any.
struct HandBones {
  Pose wrist;
  std::array<std::array<Pose, 3>, 5> fingers;  ///< from the palm to the tip
};

/// Size of the palm (m): the longest side of the triangle of wrist, index knuckle and little knuckle. A view onto the
/// edge of the palm shortens this side least.
double palm_size(const Landmarks& landmarks);

/// The lengths are those of the hand model. Landmarks give directions only.
class LandmarkLifter {
 public:
  /// Mirrors the hand model if it is of the other side.
  LandmarkLifter(const HandModel& hand, Side side);

  /// Landmarks are in metres in a right-handed frame. The joints are in the same frame. Empty if the landmarks do not
  /// have the shape of a hand (palm without extent, joints in one place).
  std::optional<JointFrames> lift(const Landmarks& landmarks) const;
  /// Writes the lifted joints and their flags and radii into `out`. Joints without a landmark are inferred. Returns
  /// false, without a change, if the landmarks do not have the shape of a hand.
  bool lift(const Landmarks& landmarks, Skeleton& out) const;

  /// The same for bones. Such skeletons have no tips: the last bone is guessed to continue along the bone before it,
  /// and the tip is inferred.
  bool lift(const HandBones& bones, Skeleton& out) const;

  /// Palm size of the hand model, m.
  double palm_size() const { return palm_size_; }

 private:
  JointFrames rest_;
  std::array<double, kJointCount> radii_;
  double palm_size_;
};

}  // namespace softhand
