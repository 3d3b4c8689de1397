// Messages with 21 landmarks of a hand, from a model that sees a camera's picture: README.md.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string_view>

#include "device/arrival_queue.hpp"
#include "device/clock_mapping.hpp"
#include "device/landmark_lifter.hpp"
#include "math/types.hpp"
#include "messages/messages.hpp"
#include "model/hand_model.hpp"
#include "trackers/landmarks/landmarks_options.hpp"

namespace softhand {

enum class Coordinates : std::uint8_t {
  world,  ///< metres, x right, y down, z away from the camera
  image,  ///< x, y: 0 to 1 across the picture from its upper left corner; z: away from the camera in picture widths
};

struct LandmarksMessage {
  Side side = Side::right;
  Coordinates coordinates = Coordinates::world;
  double aspect = 1;                             ///< width / height of the picture; image coordinates only
  double score = 1;                              ///< 0..1
  std::optional<double> sample_time;             ///< ms, the sender's clock; time of the picture
  std::optional<double> sent_time;               ///< ms, the sender's clock; present with sample_time
  std::array<Vec3, kLandmarkCount> landmarks{};  ///< in the order of MediaPipe
};

enum class LandmarksRefusal : std::uint8_t { none, json, version, content, shape, order };
inline constexpr std::array<std::string_view, 6> kLandmarksRefusalNames{"none",    "json",  "version",
                                                                        "content", "shape", "order"};

/// Decodes a message. `out` is unchanged if the text is refused. Allocates.
LandmarksRefusal decode_landmarks(std::string_view text, LandmarksMessage& out);
/// Turns a message into a `DecodedLandmarks`, in the thread that receives it.
struct DecodedLandmarks {
  LandmarksRefusal refusal = LandmarksRefusal::none;
  LandmarksMessage message;
};
Translate translate_landmarks();

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

/// Places the landmarks of a message in the world, in metres, with the options of the camera. The size of the user's
/// palm (m) gives the scale of image coordinates. Empty if the palm in the picture has no extent.
std::optional<Landmarks> place_landmarks(const LandmarksMessage& message, const LandmarksOptions& options, double palm);

}  // namespace softhand
