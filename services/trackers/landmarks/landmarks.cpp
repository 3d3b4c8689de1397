#include "trackers/landmarks/landmarks.hpp"

#include <Eigen/SVD>
#include <cmath>
#include <nlohmann/json.hpp>

namespace softhand {
namespace {

using Json = nlohmann::json;

constexpr double kFarthest = 100;       // metres or picture widths
constexpr double kLatestTime = 9e12;    // ms; Unix time fits, and its nanoseconds fit into a stamp
constexpr double kShortestBone = 1e-4;  // m between landmarks; a shorter bone has no direction
constexpr std::array<std::size_t, 5> kPalm{0, 5, 9, 13, 17};

std::size_t at(Joint joint) { return static_cast<std::size_t>(index_of(joint)); }

// Size of the palm from three points: the longest side of the triangle of wrist, index knuckle and little knuckle. A
// view onto the edge of the palm shortens this side least.
double palm_size(const Vector3& wrist, const Vector3& index, const Vector3& little) {
  return std::max({(index - wrist).norm(), (little - wrist).norm(), (index - little).norm()});
}

std::optional<double> number(const Json& json, const char* key, double minimum, double maximum) {
  const auto found = json.find(key);
  if (found == json.end() || !found->is_number()) return std::nullopt;
  const double value = found->get<double>();
  if (!(value >= minimum && value <= maximum)) return std::nullopt;
  return value;
}

// Least-squares rotation of `from` (rest pose) to `to`, each about its mean. Empty if the points lie on a line.
std::optional<Quaternion> turn_between(const std::array<Vector3, kPalm.size()>& from,
                                       const std::array<Vector3, kPalm.size()>& to) {
  Vector3 from_mean = Vector3::Zero(), to_mean = Vector3::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    from_mean += from[i] / static_cast<double>(from.size());
    to_mean += to[i] / static_cast<double>(from.size());
  }
  Matrix3 covariance = Matrix3::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) covariance += (to[i] - to_mean) * (from[i] - from_mean).transpose();
  const Eigen::JacobiSVD<Matrix3> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  if (!(svd.singularValues()[1] > 1e-3 * svd.singularValues()[0]) ||
      !(svd.singularValues()[1] > kShortestBone * kShortestBone))
    return std::nullopt;
  Vector3 signs(1, 1, (svd.matrixU() * svd.matrixV().transpose()).determinant());
  return Quaternion(Matrix3(svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose())).normalized();
}

}  // namespace

Joint joint_of_landmark(std::size_t index) {
  if (index == 0) return Joint::wrist;
  if (index <= 4) return static_cast<Joint>(index + 1);  // thumb: metacarpal .. tip
  const std::size_t finger = (index - 5) / 4;
  return static_cast<Joint>(7 + 5 * finger + (index - 5) % 4);  // proximal .. tip
}

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
      message.landmarks[i][static_cast<Eigen::Index>(axis)] = value;
    }
  }
  out = message;
  return LandmarksRefusal::none;
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

LandmarkLifter::LandmarkLifter(const HandModel& hand)
    : rest_(hand.rest_joints),
      palm_size_(palm_size(rest_[at(Joint::wrist)].position, rest_[at(Joint::index_proximal)].position,
                           rest_[at(Joint::little_proximal)].position)) {}

std::optional<Landmarks> LandmarkLifter::place(const LandmarksMessage& message, const LandmarksOptions& options) const {
  Landmarks points = message.landmarks;
  double scale = 1;
  Vector3 origin(0, 0, options.distance);
  if (message.coordinates == Coordinates::image) {
    for (Vector3& point : points) point = Vector3(point.x() - 0.5, (point.y() - 0.5) / message.aspect, point.z());
    // Weak perspective: the whole hand has the scale of its palm. Its depth is that at which a camera sees a palm of
    // this size.
    const double size = palm_size(points[0], points[5], points[17]);
    if (!(size > 1e-3)) return std::nullopt;
    scale = palm_size_ / size;
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

std::optional<JointFrames> LandmarkLifter::lift(const Landmarks& landmarks) const {
  std::array<Vector3, kPalm.size()> rest_palm, palm;
  for (std::size_t i = 0; i < kPalm.size(); ++i) {
    rest_palm[i] = rest_[at(joint_of_landmark(kPalm[i]))].position;
    palm[i] = landmarks[kPalm[i]];
  }
  const auto turn = turn_between(rest_palm, palm);
  if (!turn) return std::nullopt;

  JointFrames out;
  // From the rest frame to the frame of the landmarks.
  const Pose hand{landmarks[0] - *turn * rest_[at(Joint::wrist)].position, *turn};
  out[at(Joint::wrist)] = hand * rest_[at(Joint::wrist)];
  for (int finger = 0; finger < kFingerCount; ++finger) {
    const std::size_t tip = at(tip_of(static_cast<Finger>(finger)));
    const std::size_t base = finger == 0 ? tip - 3 : tip - 4;  // metacarpal
    // Metacarpals start at their place in the palm. Each bone turns against its parent by the smallest rotation that
    // points it to the next landmark. This is the motion of a joint that flexes and abducts without twist.
    out[base] = hand * rest_[base];
    for (std::size_t joint = base; joint < tip; ++joint) {
      const std::size_t landmark =
          static_cast<std::size_t>(4 * finger) + (joint - base) + (finger == 0 ? 1 : 0);  // of this joint
      const Pose bone = rest_[joint].inverse() * rest_[joint + 1];
      // Only the thumb has a landmark at the start of its metacarpal.
      const Vector3 from = joint == base && finger > 0 ? out[base].position : landmarks[landmark];
      const Vector3 towards = landmarks[landmark + 1] - from;
      if (!(towards.norm() > kShortestBone)) return std::nullopt;
      const Quaternion swing = Quaternion::FromTwoVectors(out[joint].orientation * bone.position, towards);
      out[joint].orientation = (swing * out[joint].orientation).normalized();
      out[joint + 1] = out[joint] * bone;
    }
  }
  // The palm moves with the middle metacarpal.
  const std::size_t metacarpal = at(Joint::middle_metacarpal);
  out[at(Joint::palm)] = out[metacarpal] * (rest_[metacarpal].inverse() * rest_[at(Joint::palm)]);
  return out;
}

}  // namespace softhand
