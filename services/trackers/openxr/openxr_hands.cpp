#include "trackers/openxr/openxr_hands.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "device/body_mount.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr std::uint64_t kPoseValid = 1 | 2, kPoseTracked = 4 | 8, kVelocityValid = 1 | 2;
constexpr double kLargestRadius = 0.1, kFastest = 1000;  // m; m/s and rad/s
constexpr double kControllerConfidence = 0.5;            // of a hand that is guessed from a controller

// Returns false if the joint says that it is valid and has no pose.
bool read_pose(const OpenXrJoint& from, Pose& out) {
  out.position = Vector3(from.position[0], from.position[1], from.position[2]);
  out.orientation = Quaternion(from.orientation[3], from.orientation[0], from.orientation[1], from.orientation[2]);
  return make_plausible(out);
}
bool is_valid(const OpenXrJoint& joint) { return (joint.flags & kPoseValid) == kPoseValid; }

bool read_velocity(const std::array<float, 3>& from, Vec3& out) {
  std::copy(from.begin(), from.end(), out.begin());
  return std::all_of(out.begin(), out.end(), [](double x) { return std::abs(x) <= kFastest; });
}

}  // namespace

void OpenXrDecoder::take(const Arrival& packet, TrackerSink& out) { refusals_.accepted(take_frame(packet, out)); }

OpenXrRefusal OpenXrDecoder::take_frame(const Arrival& packet, TrackerSink& out) {
  OpenXrFrame frame;
  std::memcpy(&frame, packet.bytes.data(), sizeof frame);
  if (frame.time <= newest_) return OpenXrRefusal::order;
  // The whole frame is read before anything is delivered.
  for (std::size_t side = 0; side < 2; ++side)
    if (!read_hand(frame.hands[side], hands_[side])) return OpenXrRefusal::content;
  Pose head;
  head_.valid = is_valid(frame.head) ? 1 : 0;
  if (head_.valid != 0 && !read_pose(frame.head, head)) return OpenXrRefusal::content;
  newest_ = frame.time;
  const Nanoseconds time = std::min(frame.time, packet.time);
  head_.position = to_wire(head.position);
  head_.orientation = to_wire(head.orientation);
  stamps_.stamp(SampleStamps::kHead, time, head_.stamp);
  out.head(head_);
  for (std::size_t side = 0; side < 2; ++side) {
    hands_[side].hand.side = static_cast<std::uint32_t>(side);
    stamps_.stamp(side, time, hands_[side].stamp);
    out.hand(hands_[side]);
  }
  return OpenXrRefusal::none;
}

bool OpenXrDecoder::read_hand(const OpenXrHand& from, Skeleton& out) {
  out.confidence = 0;
  if (!from.is_active) return true;
  int tracked = 0;
  for (std::size_t j = 0; j < kJointCount; ++j) {
    const OpenXrJoint& joint = from.joints[j];
    out.joints[j] = JointSample{};
    if (!is_valid(joint)) continue;
    Pose pose;
    const auto radius = static_cast<double>(joint.radius);
    if (!read_pose(joint, pose) || !(radius >= 0 && radius <= kLargestRadius)) return false;
    const bool is_tracked = (joint.flags & kPoseTracked) == kPoseTracked && !from.is_from_controller;
    tracked += is_tracked ? 1 : 0;
    JointSample& sample = out.joints[j];
    sample.position = to_wire(pose.position);
    sample.orientation = to_wire(pose.orientation);
    sample.radius = radius;
    sample.flags = kJointValid | (is_tracked ? kJointTracked : kJointInferred);
    if (!is_tracked) sample.confidence = kGuessedConfidence;
    const OpenXrVelocity& velocity = from.velocities[j];
    if ((velocity.flags & kVelocityValid) != kVelocityValid) continue;
    if (!read_velocity(velocity.linear, sample.linear_velocity) ||
        !read_velocity(velocity.angular, sample.angular_velocity))
      return false;
    sample.velocity_valid = 1;
  }
  out.confidence = from.is_from_controller ? kControllerConfidence : static_cast<double>(tracked) / kJointCount;
  return true;
}

}  // namespace softhand
