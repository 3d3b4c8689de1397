// Measures a user's hand from tracked postures, for `softhand calibrate`.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <vector>

#include "device/user_hand.hpp"
#include "messages/messages.hpp"

namespace softhand {

/// What the user is asked to show, one after the other.
enum class Posture : std::uint8_t { flat, fist, thumb_across, relaxed };
inline constexpr std::size_t kPostureCount = 4;
/// What to do, at most 50 characters.
inline constexpr std::array<std::string_view, kPostureCount> kPosturePrompts{
    "Stretch your hand flat and spread the fingers", "Make a fist", "Lay the thumb across your palm",
    "Relax your hand and turn it a little"};

class HandMeasurement {
 public:
  /// Adds a sample of this posture. Joints that are not valid, not plausible or have a confidence below 0.5 are left
  /// out, and so are samples with such a confidence.
  void add(Posture posture, const Skeleton& sample);
  std::size_t samples(Posture posture) const { return of(posture).size(); }

  /// Throws std::runtime_error if the samples do not show this posture. The message names the step and says what to do.
  /// For a posture after `flat`, that one must have passed.
  void check(Posture posture) const;
  /// The user's hand. Offsets and orientations are medians, ranges of motion leave out 2 % of the samples at each end.
  /// Throws std::runtime_error as `check` of each posture does, or if a length is not the same in all samples.
  UserHand measure(Side side) const;

 private:
  struct Frame {
    JointFrames joints;
    std::array<bool, kJointCount> good{};
  };
  const std::vector<Frame>& of(Posture posture) const { return frames_[static_cast<std::size_t>(posture)]; }
  double flexion(Posture posture, Finger finger) const;
  double thumb_distance(Posture posture) const;
  std::vector<Pose> local_poses(Joint joint) const;

  std::array<std::vector<Frame>, kPostureCount> frames_;
  std::array<std::vector<double>, kJointCount> radii_;
};

}  // namespace softhand
