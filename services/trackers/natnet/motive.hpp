// Talks with OptiTrack's Motive, and turns its frames into hands and a head (README.md).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "device/arrival_queue.hpp"
#include "device/landmark_lifter.hpp"
#include "device/refusals.hpp"
#include "device/sample_stamps.hpp"
#include "device/tracker_source.hpp"
#include "runtime/clock_offset.hpp"
#include "trackers/natnet/natnet_options.hpp"
#include "trackers/natnet/natnet_packet.hpp"

namespace softhand {

enum class MotiveRefusal : std::uint8_t { none, size, version, content, models, order, shape };
inline constexpr std::array<std::string_view, 7> kMotiveRefusalNames{"none",   "size",  "version", "content",
                                                                     "models", "order", "shape"};

/// The side and the place of a skeleton's bone in a hand, by its name in Motive or in FBX, without the name of the
/// skeleton: "LHand", "RIndex1", "LeftHandThumb3". Empty for other bones.
struct BoneOfHand {
  Side side;
  int finger;  ///< -1 for the hand itself
  int joint;   ///< 0 to 2, from the palm to the tip
};
std::optional<BoneOfHand> bone_of_hand(std::string_view name);

/// NatNet's header before a payload.
std::string natnet_packet(NatNetMessage message, std::string_view payload);

class MotiveDecoder {
 public:
  /// Bone lengths and radii are those of the hand, or of its mirror image. Throws std::invalid_argument if a mount is
  /// no pose.
  MotiveDecoder(const HandModel& hand, const NatNetOptions& options);

  /// Does not allocate.
  void take(const Arrival& packet, TrackerSink& out);
  /// Sends what Motive has to hear now: who we are until it answers, then questions about its clock and its skeletons,
  /// and, for unicast, that we are still there. Does not allocate.
  template <typename Send>
  void speak(Nanoseconds now, Send&& send) {
    if (now < next_words_) return;
    next_words_ = now + kBetweenWords;
    if (!server_ || asks_version_ || is_silent(now)) send(connect_);
    if (!server_) return;
    if (wants_older_bitstream_) send(older_bitstream_);
    wants_older_bitstream_ = false;
    if (!is_multicast_) send(keep_alive_);
    if (needs_models_) send(request_models_);
    send(echo_request(now));
  }
  const Refusals<MotiveRefusal, kMotiveRefusalNames.size()>& refusals() const { return refusals_; }

 private:
  static constexpr Nanoseconds kSilence = 1'500'000'000;     // then the server was switched off
  static constexpr Nanoseconds kBetweenWords = 300'000'000;  // Motive forgets a silent client after some seconds
  static constexpr std::size_t kMostBones = 256;
  struct Body {
    std::int32_t id = 0;
    Pose mount;  // of the wrist or head in the body
  };
  struct Hand {
    std::int32_t wrist = 0;  // bone IDs of the skeleton; 0 = not defined
    std::array<std::array<std::int32_t, 3>, 5> fingers{};
    bool is_defined() const;
  };
  struct SeenBone {
    Pose pose;
    bool is_seen = false, is_tracked = false;
  };

  MotiveRefusal take_packet(const Arrival& packet, TrackerSink& out);
  MotiveRefusal take_server_info(std::string_view payload, Nanoseconds arrival);
  MotiveRefusal take_models(std::string_view payload);
  MotiveRefusal take_echo(std::string_view payload, Nanoseconds arrival);
  MotiveRefusal take_frame(std::string_view payload, Nanoseconds arrival, TrackerSink& out);
  // Returns false if a tracked bone has no pose.
  bool read_bones(NatNetBodies seen);
  // Fills joints and confidence of `hand_` from the bones. Returns false if they are not the shape of a hand.
  bool lift_hand(std::size_t side);
  std::string_view echo_request(Nanoseconds now);
  void forget_server();
  bool is_silent(Nanoseconds now) const { return now - shown_ > kSilence; }
  NatNetVersion bitstream() const { return std::min(server_->version, kNewestNatNet); }
  // The world's axes. Empty if the numbers are no pose.
  std::optional<Pose> to_world(Pose pose) const;
  std::optional<Pose> bone_pose(std::int32_t id) const;
  Nanoseconds to_nanoseconds(std::uint64_t ticks) const;
  Nanoseconds time_of(const NatNetFrame& frame, Nanoseconds arrival) const;

  const bool is_multicast_, is_z_up_, has_local_bones_;
  const std::string skeleton_name_;
  const std::array<Body, 3> bodies_;  // left, right, head
  std::string connect_, keep_alive_, request_models_, older_bitstream_, echo_;
  std::array<LandmarkLifter, 2> lifters_;  // left, right

  std::optional<NatNetServer> server_;
  Nanoseconds shown_ = 0, next_words_ = 0;  // newest frame or greeting; next time to speak
  bool asks_version_ = false, needs_models_ = false, wants_older_bitstream_ = false;
  std::uint16_t parameters_ = 0;  // of the newest frame
  std::optional<std::int32_t> number_;
  ClockOffset clock_;
  std::optional<ClockOffset::Estimate> offset_;
  Nanoseconds offset_time_ = 0;

  std::optional<std::int32_t> skeleton_;
  std::array<Hand, 2> hand_bones_{};
  std::array<std::int32_t, kMostBones> parents_{};
  std::array<SeenBone, kMostBones> bones_{};

  SampleStamps stamps_;
  Skeleton hand_;
  HeadPose head_;
  Refusals<MotiveRefusal, kMotiveRefusalNames.size()> refusals_{kMotiveRefusalNames};
};

}  // namespace softhand
