// The lines of the app Hand Tracking Streamer (README.md): decoded and converted to hands and a head.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "device/arrival_queue.hpp"
#include "device/clock_mapping.hpp"
#include "device/landmark_lifter.hpp"
#include "device/refusals.hpp"
#include "device/tracker_source.hpp"

namespace softhand {

inline constexpr std::size_t kLargestStreamerPacket = 4096;  ///< bytes; one hand needs about 700

enum class StreamerRefusal : std::uint8_t { none, label, numbers, content, unpaired, shape, order };
inline constexpr std::array<std::string_view, 7> kStreamerRefusalNames{"none",     "label", "numbers", "content",
                                                                       "unpaired", "shape", "order"};

struct StreamerLine {
  enum class Kind : std::uint8_t { wrist, landmarks, head };
  Kind kind = Kind::wrist;
  Side side = Side::right;          ///< of a wrist or landmarks
  std::optional<Nanoseconds> sent;  ///< the headset's clock; only with the app's debug header
  Pose pose;                        ///< of a wrist or a head: world, right-handed, +Y up
  Landmarks landmarks;              ///< m, in the frame of the wrist
};

/// Decodes one line without its end. `out` is unspecified if the line is refused. Does not allocate.
StreamerRefusal decode_streamer_line(std::string_view line, StreamerLine& out);

/// Some versions of the app send the little finger from its metacarpal to its distal joint, without the tip. Then the
/// four points are moved to their joints, and the tip is guessed along the last bone. Returns true if this was so.
bool mend_little_finger(Landmarks& landmarks);

/// Turns packets into samples. All connections are of one headset, with one clock.
class StreamerDecoder {
 public:
  /// Bone lengths and radii are those of the hand, or of its mirror image.
  explicit StreamerDecoder(const HandModel& hand);

  /// A datagram with all lines of a hand, or one line of a stream. Does not allocate.
  void take(const Arrival& packet, TrackerSink& out);
  const Refusals<StreamerRefusal, kStreamerRefusalNames.size()>& refusals() const { return refusals_; }

 private:
  struct Wrist {
    std::uint64_t connection = 0;
    bool waits = false;  // for its landmarks
    StreamerLine line;
  };

  StreamerRefusal take_line(std::string_view text, const Arrival& packet, TrackerSink& out);
  StreamerRefusal take_landmarks(const StreamerLine& wrist, const Arrival& packet, TrackerSink& out);
  // Time of a sample on our clock. `track`: 0 left, 1 right, 2 head. Empty if it is not newer than the one before.
  std::optional<Nanoseconds> time_of(const StreamerLine& line, Nanoseconds arrival, std::size_t track);
  Wrist& wrist_of(std::uint64_t connection);

  std::array<LandmarkLifter, 2> lifters_;  // left, right
  std::array<Wrist, 8> wrists_;
  ClockMapping clock_;
  std::array<std::optional<Nanoseconds>, 3> sent_;  // the headset's clock
  std::array<Nanoseconds, 3> last_{};               // our clock
  std::array<std::uint64_t, 3> sequence_{};
  StreamerLine line_;
  Skeleton hand_;
  HeadPose head_;
  Refusals<StreamerRefusal, kStreamerRefusalNames.size()> refusals_{kStreamerRefusalNames};
};

}  // namespace softhand
