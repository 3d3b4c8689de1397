#include "trackers/landmarks/landmarks.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "messages/convert.hpp"

namespace softhand {
namespace {

using Json = nlohmann::json;

constexpr double kFarthest = 100;     // metres or picture widths
constexpr double kLatestTime = 9e12;  // ms; Unix time fits, and its nanoseconds fit into a stamp

std::optional<double> number(const Json& json, const char* key, double minimum, double maximum) {
  const auto found = json.find(key);
  if (found == json.end() || !found->is_number()) return std::nullopt;
  const double value = found->get<double>();
  if (!(value >= minimum && value <= maximum)) return std::nullopt;
  return value;
}

}  // namespace

LandmarksRefusal decode_landmarks(std::string_view text, LandmarksMessage& out) {
  const Json json = Json::parse(text, nullptr, false);
  if (json.is_discarded() || !json.is_object()) return LandmarksRefusal::json;
  const auto version = json.find("version");
  if (version == json.end() || *version != 1) return LandmarksRefusal::version;
  LandmarksMessage message;
  const auto hand = json.find("hand");
  if (hand == json.end() || (*hand != "left" && *hand != "right")) return LandmarksRefusal::content;
  message.side = *hand == "left" ? Side::left : Side::right;
  const auto coordinates = json.find("coordinates");
  if (coordinates == json.end() || (*coordinates != "world" && *coordinates != "image"))
    return LandmarksRefusal::content;
  if (*coordinates == "image") {
    message.coordinates = Coordinates::image;
    const auto aspect = number(json, "aspect", 0.1, 10);
    if (!aspect) return LandmarksRefusal::content;
    message.aspect = *aspect;
  }
  if (json.contains("score")) {
    const auto score = number(json, "score", 0, 1);
    if (!score) return LandmarksRefusal::content;
    message.score = *score;
  }
  if (json.contains("sample_time_ms") || json.contains("sent_time_ms")) {
    message.sample_time = number(json, "sample_time_ms", 0, kLatestTime);
    message.sent_time = number(json, "sent_time_ms", 0, kLatestTime);
    // A picture is taken before it is sent, and at most 1 s before.
    if (!message.sample_time || !message.sent_time || *message.sample_time > *message.sent_time ||
        *message.sample_time < *message.sent_time - 1000)
      return LandmarksRefusal::content;
  }
  const auto landmarks = json.find("landmarks");
  if (landmarks == json.end() || !landmarks->is_array() || landmarks->size() != kLandmarkCount)
    return LandmarksRefusal::content;
  for (std::size_t i = 0; i < kLandmarkCount; ++i) {
    const Json& point = (*landmarks)[i];
    if (!point.is_array() || point.size() != 3) return LandmarksRefusal::content;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      if (!point[axis].is_number()) return LandmarksRefusal::content;
      const double value = point[axis].get<double>();
      if (!(std::abs(value) <= kFarthest)) return LandmarksRefusal::content;
      message.landmarks[i][axis] = value;
    }
  }
  out = message;
  return LandmarksRefusal::none;
}

Translate translate_landmarks() {
  return [decoded = DecodedLandmarks{}](const Arrival& arrival) mutable {
    decoded = {};
    decoded.refusal = decode_landmarks(arrival.bytes, decoded.message);
    return packet_of(decoded);
  };
}

std::optional<Nanoseconds> LandmarksClock::stamp(const LandmarksMessage& message, std::uint64_t connection,
                                                 Nanoseconds arrival) {
  const auto side = static_cast<std::size_t>(message.side);
  Nanoseconds& last = last_[side];
  if (!message.sample_time) {
    if (arrival <= last) return std::nullopt;
    return last = arrival;
  }
  if (connection != connection_) {
    connection_ = connection;
    mapping_ = {};
    sampled_ = {};
  }
  const auto nanoseconds = [](double milliseconds) { return static_cast<Nanoseconds>(milliseconds * 1e6); };
  if (mapping_.add(nanoseconds(*message.sent_time), arrival)) sampled_ = {};
  std::optional<double>& sampled = sampled_[side];
  if (sampled && *message.sample_time <= *sampled) return std::nullopt;
  sampled = message.sample_time;
  // Keep the times ascending, even if a better estimate of the offset would move them back.
  return last = std::max(last + 1, std::min(mapping_.map(nanoseconds(*message.sample_time)), arrival));
}

std::optional<Landmarks> place_landmarks(const LandmarksMessage& message, const LandmarksOptions& options,
                                         double palm) {
  Landmarks points;
  std::transform(message.landmarks.begin(), message.landmarks.end(), points.begin(),
                 [](const Vec3& point) { return to_vector(point); });
  double scale = 1;
  Vector3 origin(0, 0, options.distance);
  if (message.coordinates == Coordinates::image) {
    for (Vector3& point : points) point = Vector3(point.x() - 0.5, (point.y() - 0.5) / message.aspect, point.z());
    // Weak perspective: the whole hand has the scale of its palm. Its depth is that at which a camera sees a palm of
    // this size.
    const double size = palm_size(points);
    if (!(size > 1e-3)) return std::nullopt;
    scale = palm / size;
    origin = Vector3(0, 0, scale * 0.5 / std::tan(0.5 * options.field_of_view));
  }
  const Quaternion orientation = Quaternion(options.camera_orientation[3], options.camera_orientation[0],
                                            options.camera_orientation[1], options.camera_orientation[2])
                                     .normalized();
  const Vector3 position(options.camera_position[0], options.camera_position[1], options.camera_position[2]);
  for (Vector3& point : points) {
    point = scale * point + origin;
    if (options.mirrored) point.x() = -point.x();
    point = position + orientation * Vector3(point.x(), -point.y(), -point.z());
  }
  return points;
}

}  // namespace softhand
