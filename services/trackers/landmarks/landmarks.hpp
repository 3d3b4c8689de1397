// 21 landmarks of a hand (MediaPipe's order) and how they become the 26 joints of a hand with given bones:
// docs/tracker-landmarks.md.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "math/types.hpp"
#include "messages/messages.hpp"
#include "model/hand_model.hpp"
#include "trackers/landmarks/landmarks_options.hpp"
#include "trackers/replay/motion.hpp"
#include "trackers/sockets/clock_mapping.hpp"

namespace softhand {

inline constexpr std::size_t kLandmarkCount = 21;
using Landmarks = std::array<Vector3, kLandmarkCount>;

enum class Coordinates : std::uint8_t {
  world,  ///< metres, x right, y down, z away from the camera
  image,  ///< x, y from 0 to 1 across the picture from its upper left corner; z away from the camera in picture widths
};

struct LandmarksMessage {
  Side side = Side::right;
  Coordinates coordinates = Coordinates::world;
  double aspect = 1;                  ///< width / height of the picture; image coordinates only
  double score = 1;                   ///< 0..1
  std::optional<double> sample_time;  ///< ms, the sender's clock: when the picture was taken
  std::optional<double> sent_time;    ///< ms, the sender's clock; with sample_time
  Landmarks landmarks;
};

enum class LandmarksRefusal : std::uint8_t { none, json, version, content, shape, order };
inline constexpr std::array<std::string_view, 6> kLandmarksRefusalNames{"none",    "json",  "version",
                                                                        "content", "shape", "order"};

/// All or nothing: `out` is untouched where the text is refused.
LandmarksRefusal decode_landmarks(std::string_view text, LandmarksMessage& out);

/// Puts messages on our clock. A connection is a clock of its own.
class LandmarksClock {
 public:
  /// When the picture of a message was taken, ascending for each hand; none where it is not newer than the one before
  /// of this hand and connection.
  std::optional<Nanoseconds> stamp(const LandmarksMessage& message, std::uint64_t connection, Nanoseconds arrival);

 private:
  ClockMapping mapping_;
  std::uint64_t connection_ = 0;
  std::array<std::optional<double>, 2> sampled_;  // ms, the sender's clock
  std::array<Nanoseconds, 2> last_{};             // ours
};

/// Lifts landmarks to the joints of one hand. The hand's own lengths hold; landmarks give directions.
class LandmarkLifter {
 public:
  explicit LandmarkLifter(const HandModel& hand);

  /// Landmarks in metres in a right-handed frame; the joints come in the same frame. None where they have no shape of a
  /// hand (palm without extent, joints in one place).
  std::optional<JointFrames> lift(const Landmarks& landmarks) const;

  /// Places a message's landmarks in the world, in metres, by the camera's options. The hand's size sets the scale of
  /// image coordinates. None where the palm has no extent.
  std::optional<Landmarks> place(const LandmarksMessage& message, const LandmarksOptions& options) const;

 private:
  JointFrames rest_;
  double palm_size_;  // m, as `palm_size` measures it
};

/// The joint that landmark `index` marks.
Joint joint_of_landmark(std::size_t index);

}  // namespace softhand
