#include "trackers/webxr/webxr_frames.hpp"

#include <bit>
#include <cmath>
#include <cstring>

#include "messages/convert.hpp"
#include "trackers/replay/motion.hpp"

namespace softhand {
namespace {

constexpr double kNanosecondsPerMillisecond = 1e6;
constexpr double kFarthest = 1000;              // m
constexpr double kLargestRadius = 0.1;          // m
constexpr double kLatestSend = 1e12;            // ms, thirty years
constexpr double kOldest = 1000, kAhead = 200;  // ms, limits of the sample time before and after the sending

class Reader {
 public:
  explicit Reader(std::string_view bytes) : bytes_(bytes) {}
  template <typename T>
  T read() {
    T value;
    std::memcpy(&value, bytes_.data(), sizeof(T));
    bytes_.remove_prefix(sizeof(T));
    return value;
  }
  // Returns false if the numbers are not a pose. A unit quaternion of floats is exact to 1e-6. The limit of 1 % also
  // accepts imprecise senders.
  bool read_pose(Vec3& position, Vec4& orientation) {
    for (double& value : position) value = static_cast<double>(read<float>());
    for (double& value : orientation) value = static_cast<double>(read<float>());
    for (const double value : position)
      if (!(std::abs(value) <= kFarthest)) return false;
    const Quaternion turn = to_quaternion(orientation);
    if (!(std::abs(turn.norm() - 1) < 0.01)) return false;
    orientation = to_wire(turn.normalized());
    return true;
  }

 private:
  std::string_view bytes_;
};

}  // namespace

WebXrRefusal decode_webxr(std::string_view bytes, WebXrSample& out) {
  if (bytes.size() != kWebXrFrameSize) return WebXrRefusal::size;
  Reader reader(bytes);
  if (reader.read<std::uint32_t>() != kWebXrMagic) return WebXrRefusal::magic;
  if (reader.read<std::uint16_t>() != kWebXrVersion) return WebXrRefusal::version;
  reader.read<std::uint16_t>();
  WebXrSample sample;
  const double taken = reader.read<double>();
  const double sent = reader.read<double>();
  if (!(sent >= 0 && sent < kLatestSend && taken > sent - kOldest && taken < sent + kAhead))
    return WebXrRefusal::content;
  sample.sample_time = static_cast<Nanoseconds>(taken * kNanosecondsPerMillisecond);
  sample.sent = static_cast<Nanoseconds>(sent * kNanosecondsPerMillisecond);
  sample.head.valid = reader.read<std::uint32_t>();
  if (sample.head.valid > 1) return WebXrRefusal::content;
  // The pose of an unseen head may have any values.
  if (!reader.read_pose(sample.head.position, sample.head.orientation)) {
    if (sample.head.valid != 0) return WebXrRefusal::content;
    sample.head.position = {};
    sample.head.orientation = {0, 0, 0, 1};
  }
  for (std::uint32_t side = 0; side < 2; ++side) {
    Skeleton& hand = sample.hands[side];
    hand.hand.side = side;
    const auto seen = reader.read<std::uint32_t>();
    if (seen >> (kJointCount - 1) != 0) return WebXrRefusal::content;
    for (std::size_t j = 1; j < kJointCount; ++j) {
      JointSample joint;
      const bool is_pose = reader.read_pose(joint.position, joint.orientation);
      joint.radius = static_cast<double>(reader.read<float>());
      if ((seen >> (j - 1) & 1u) == 0) continue;
      if (!is_pose || !(joint.radius >= 0 && joint.radius <= kLargestRadius)) return WebXrRefusal::content;
      joint.flags = kJointValid | kJointTracked;
      hand.joints[j] = joint;
    }
    const JointSample& metacarpal = hand.joints[static_cast<std::size_t>(index_of(Joint::middle_metacarpal))];
    const JointSample& proximal = hand.joints[static_cast<std::size_t>(index_of(Joint::middle_proximal))];
    if ((metacarpal.flags & proximal.flags & kJointValid) != 0) {
      const Pose palm = palm_between(to_pose(metacarpal), to_pose(proximal));
      hand.joints[0].position = to_wire(palm.position);
      hand.joints[0].orientation = to_wire(palm.orientation);
      hand.joints[0].radius = metacarpal.radius;
      hand.joints[0].flags = kJointValid | kJointInferred;
    }
    hand.confidence = static_cast<double>(std::popcount(seen)) / (kJointCount - 1);
  }
  out = sample;
  return WebXrRefusal::none;
}

WebXrRefusal WebXrClock::stamp(WebXrSample& sample, std::uint64_t connection, Nanoseconds arrival) {
  if (connection != connection_) {
    connection_ = connection;
    mapping_ = {};
    last_ = 0;
  }
  if (last_ != 0 && sample.sample_time <= last_) return WebXrRefusal::order;
  last_ = sample.sample_time;
  mapping_.add(sample.sent, arrival);
  // Keep the times ascending, even if a better estimate of the offset would move them back.
  last_mapped_ = std::max(last_mapped_ + 1, std::min(mapping_.map(sample.sample_time), arrival));
  ++sequence_;
  for (Stamp* stamp : {&sample.head.stamp, &sample.hands[0].stamp, &sample.hands[1].stamp}) {
    stamp->sample_time = last_mapped_;
    stamp->sequence = sequence_;
    stamp->chain.tracker_sample = last_mapped_;
  }
  return WebXrRefusal::none;
}

}  // namespace softhand
