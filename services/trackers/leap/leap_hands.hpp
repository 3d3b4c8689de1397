// Hands from the frames of an Ultraleap camera (README.md).
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "device/arrival_queue.hpp"
#include "device/clock_mapping.hpp"
#include "device/landmark_lifter.hpp"
#include "device/refusals.hpp"
#include "device/sample_stamps.hpp"
#include "device/tracker_source.hpp"
#include "trackers/leap/leap_frame.hpp"

namespace softhand {

class LeapDecoder {
 public:
  /// Frames without all bones get the bone lengths of the hand, or of its mirror image.
  LeapDecoder(const HandModel& hand, bool is_on_headset);

  /// The packet is the bytes of a LeapFrame. Does not allocate.
  void take(const Arrival& packet, TrackerSink& out);
  const Refusals<LeapRefusal, kLeapRefusalNames.size()>& refusals() const { return refusals_; }

 private:
  LeapRefusal take_frame(const Arrival& packet, TrackerSink& out);
  // Fill joints, flags and radii of `hand_`. Return false if the bones are not the shape of a hand.
  bool use_bones(const LeapHand& hand);
  bool use_landmarks(const LeapHand& hand);

  std::array<LandmarkLifter, 2> lifters_;    // left, right
  std::array<Vector3, 2> wrist_to_knuckle_;  // of the middle finger, in the frame of the wrist
  LeapFrame frame_;
  std::uint64_t connection_ = 0;
  std::optional<Nanoseconds> sent_;  // time of the newest frame, the service's clock
  ClockMapping clock_;
  SampleStamps stamps_;
  Skeleton hand_;
  Refusals<LeapRefusal, kLeapRefusalNames.size()> refusals_{kLeapRefusalNames};
};

}  // namespace softhand
