// Hands and a head from the messages of a VMC performer, wrists from OSC trackers, and plain hands (README.md).
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <string_view>

#include "device/arrival_queue.hpp"
#include "device/curl_lifter.hpp"
#include "device/landmark_lifter.hpp"
#include "device/refusals.hpp"
#include "device/sample_stamps.hpp"
#include "device/tracker_source.hpp"
#include "trackers/osc/osc_options.hpp"
#include "trackers/osc/osc_packet.hpp"

namespace softhand {

inline constexpr std::size_t kLargestOscPacket = 8192;  ///< bytes; a bundle of all 55 bones needs about 5,000
inline constexpr std::size_t kOscSlots = 512;           ///< packets; a frame of single messages has about 150

enum class OscRefusal : std::uint8_t { none, format, content, incomplete, shape };
inline constexpr std::array<std::string_view, 5> kOscRefusalNames{"none", "format", "content", "incomplete", "shape"};

/// Bones of the chain to both hands, by the names of Unity's HumanBodyBones.
inline constexpr std::size_t kTrunkBones = 4;  ///< Hips, Spine, Chest, UpperChest
inline constexpr std::size_t kArmBones = 4;    ///< Shoulder, UpperArm, LowerArm, Hand
inline constexpr std::size_t kFingerBones = 15;
inline constexpr std::array<std::string_view, kTrunkBones> kTrunkNames{"Hips", "Spine", "Chest", "UpperChest"};
/// After "Left" or "Right".
inline constexpr std::array<std::string_view, kArmBones + kFingerBones> kHandNames{
    "Shoulder",     "UpperArm",      "LowerArm",          "Hand",        "ThumbProximal",  "ThumbIntermediate",
    "ThumbDistal",  "IndexProximal", "IndexIntermediate", "IndexDistal", "MiddleProximal", "MiddleIntermediate",
    "MiddleDistal", "RingProximal",  "RingIntermediate",  "RingDistal",  "LittleProximal", "LittleIntermediate",
    "LittleDistal"};

/// Turns packets into samples.
class PerformerDecoder {
 public:
  /// Bone lengths and radii are those of the hand, or of its mirror image.
  PerformerDecoder(const HandModel& hand, const OscOptions& options);

  /// Does not allocate.
  void take(const Arrival& packet, TrackerSink& out);
  const Refusals<OscRefusal, kOscRefusalNames.size()>& refusals() const { return refusals_; }

 private:
  static constexpr Nanoseconds kNever = std::numeric_limits<Nanoseconds>::min() / 2;
  struct Hand {
    std::array<Pose, kArmBones + kFingerBones> bones;  // local
    std::uint32_t fresh = 0;                           // of hand and fingers, since the last sample
    bool seen = false;                                 // finger bones were sent once
  };
  struct Tracker {
    Pose pose;
    bool has_position = false, has_rotation = false;  // since the last sample
    Nanoseconds time = 0;                             // of the newest of them
  };

  struct PlainHand {
    std::array<FingerCurl, kFingerCount> fingers;
    Nanoseconds curls_time = kNever;
    Nanoseconds alone_since = kNever;  // since then curls come without a wrist
  };

  OscRefusal take_message(const OscMessage& message, Nanoseconds time, TrackerSink& out);
  OscRefusal take_bone(std::string_view name, const Pose& local, Nanoseconds time, TrackerSink& out);
  OscRefusal take_tracker(std::string_view address, const OscMessage& message, Nanoseconds time, TrackerSink& out);
  OscRefusal take_plain(std::string_view address, const OscMessage& message, Nanoseconds time, TrackerSink& out);
  OscRefusal deliver_hand(std::size_t side, Nanoseconds time, TrackerSink& out);
  void deliver(Skeleton& hand, std::size_t side, Nanoseconds time, TrackerSink& out);
  void deliver_head(const Pose& pose, Nanoseconds time, TrackerSink& out);

  const std::array<std::int64_t, 2> wrist_trackers_;  // left, right
  std::array<LandmarkLifter, 2> lifters_;
  std::array<CurlLifter, 2> curl_lifters_;
  Pose root_;
  std::array<Pose, kTrunkBones> trunk_;
  std::array<Hand, 2> hands_;
  std::array<Tracker, 9> trackers_;  // 0 = head
  std::array<PlainHand, 2> plain_hands_;
  SampleStamps stamps_;
  Skeleton hand_;
  Skeleton curled_hand_;
  HeadPose head_;
  Refusals<OscRefusal, kOscRefusalNames.size()> refusals_{kOscRefusalNames};
};

}  // namespace softhand
