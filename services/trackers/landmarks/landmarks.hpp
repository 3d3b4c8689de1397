// Converts 21 landmarks of a hand (MediaPipe's order) to the 26 joints of a hand with given bones:
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
  image,  ///< x, y: 0 to 1 across the picture from its upper left corner; z: away from the camera in picture widths
};

struct LandmarksMessage {
  Side side = Side::right;
  Coordinates coordinates = Coordinates::world;
  double aspect = 1;                  ///< width / height of the picture; image coordinates only
  double score = 1;                   ///< 0..1
  std::optional<double> sample_time;  ///< ms, the sender's clock; time of the picture
  std::optional<double> sent_time;    ///< ms, the sender's clock; present with sample_time
  Landmarks landmarks;
};

enum class LandmarksRefusal : std::uint8_t { none, json, version, content, shape, order };
inline constexpr std::array<std::string_view, 6> kLandmarksRefusalNames{"none",    "json",  "version",
                                                                        "content", "shape", "order"};

/// Decodes a message. `out` is unchanged if the text is refused.
LandmarksRefusal decode_landmarks(std::string_view text, LandmarksMessage& out);

/// Converts the times of messages to our clock. Each connection has its own clock.
class LandmarksClock {
 public:
  /// Time at which the picture of a message was taken. The times ascend for each hand. Empty if the message is not
  /// newer than the previous one of this hand and connection.
  std::optional<Nanoseconds> stamp(const LandmarksMessage& message, std::uint64_t connection, Nanoseconds arrival);

 private:
  ClockMapping mapping_;
  std::uint64_t connection_ = 0;
  std::array<std::optional<double>, 2> sampled_;  // ms, the sender's clock
  std::array<Nanoseconds, 2> last_{};             // our clock
};

/// Converts landmarks to the joints of one hand. The lengths are those of the hand model. Landmarks give directions
/// only.
class LandmarkLifter {
 public:
  explicit LandmarkLifter(const HandModel& hand);

  /// Landmarks are in metres in a right-handed frame. The joints are in the same frame. Empty if the landmarks do not
  /// have the shape of a hand (palm without extent, joints in one place).
  std::optional<JointFrames> lift(const Landmarks& landmarks) const;

  /// Places the landmarks of a message in the world, in metres, with the options of the camera. The size of the hand
  /// gives the scale of image coordinates. Empty if the palm has no extent.
  std::optional<Landmarks> place(const LandmarksMessage& message, const LandmarksOptions& options) const;

 private:
  JointFrames rest_;
  double palm_size_;  // m, as measured by `palm_size`
};

/// The joint at landmark `index`.
Joint joint_of_landmark(std::size_t index);

}  // namespace softhand
