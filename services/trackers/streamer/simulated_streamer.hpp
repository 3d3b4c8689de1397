// What the app Hand Tracking Streamer sends for given joints. For its simulator and for tests.
#pragma once

#include <cstdint>
#include <cstdio>
#include <optional>
#include <string>

#include "device/landmark_lifter.hpp"

namespace softhand {

/// Frame number and time of the app's debug header.
struct StreamerHeader {
  std::uint64_t frame = 0;
  std::uint64_t nanoseconds = 0;
};

namespace streamer_detail {
inline std::string start(const std::string& label, const std::optional<StreamerHeader>& header) {
  if (!header) return label + ":";
  return label + " | f = " + std::to_string(header->frame) + " | t = " + std::to_string(header->nanoseconds) + ":";
}
inline void add(std::string& text, const Vector3& v) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, ", %.4f, %.4f, %.4f", v.x(), v.y(), -v.z());
  text += buffer;
}
inline void add(std::string& text, const Quaternion& q) {
  char buffer[64];
  std::snprintf(buffer, sizeof buffer, ", %.3f, %.3f, %.3f, %.3f", -q.x(), -q.y(), q.z(), q.w());
  text += buffer;
}
}  // namespace streamer_detail

/// The two lines of a hand, without a final newline. Joints are in the world, as OpenXR has them.
inline std::string streamer_hand(Side side, const JointFrames& joints,
                                 const std::optional<StreamerHeader>& header = std::nullopt) {
  const std::string name = side == Side::left ? "Left" : "Right";
  const Pose& wrist = joints[static_cast<std::size_t>(index_of(Joint::wrist))];
  std::string text = streamer_detail::start(name + " wrist", header);
  streamer_detail::add(text, wrist.position);
  streamer_detail::add(text, wrist.orientation);
  text += "\n" + name + " landmarks:";
  for (std::size_t i = 0; i < kLandmarkCount; ++i)
    streamer_detail::add(text,
                         wrist.inverse() * joints[static_cast<std::size_t>(index_of(joint_of_landmark(i)))].position);
  return text;
}

inline std::string streamer_head(const Pose& head, const std::optional<StreamerHeader>& header = std::nullopt) {
  std::string text = streamer_detail::start("Head pose", header);
  streamer_detail::add(text, head.position);
  streamer_detail::add(text, head.orientation);
  return text;
}

}  // namespace softhand
