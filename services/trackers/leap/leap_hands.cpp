#include "trackers/leap/leap_hands.hpp"

#include <algorithm>
#include <cmath>

#include "messages/age.hpp"
#include "messages/convert.hpp"
#include "trackers/replay/motion.hpp"

namespace softhand {
namespace {

constexpr std::uint32_t kHeadset = 1, kDesk = 2;  // Skeleton::frame
constexpr double kFarthest = 10;                  // m
constexpr double kWidest = 0.2;                   // m
constexpr double kShortest = 1e-3;                // m; a shorter bone has no direction

// -Z along `forward`, +Y as near to `dorsal` as possible. Empty if the two are nearly parallel.
std::optional<Quaternion> orientation_of(const Vector3& forward, const Vector3& dorsal) {
  const Vector3 z = -forward.normalized(), y = dorsal - z * z.dot(dorsal);
  if (!(y.norm() > 0.1)) return std::nullopt;
  Matrix3 axes;
  axes << y.normalized().cross(z), y.normalized(), z;
  return Quaternion(axes).normalized();
}

bool is_point(const Vec3& v) {
  return all_finite(v) && std::all_of(v.begin(), v.end(), [](double x) { return std::abs(x) <= kFarthest; });
}
bool is_unit(const Vec3& v) { return all_finite(v) && std::abs(to_vector(v).norm() - 1) < 0.01; }

Vector3 wrist_to_knuckle(const HandModel& hand, Side side) {
  const JointFrames& rest = hand.side == side ? hand.rest_joints : mirrored(hand).rest_joints;
  return rest[slot_of(Joint::wrist)].inverse() * rest[slot_of(Joint::middle_proximal)].position;
}

}  // namespace

bool is_plausible(const LeapHand& hand) {
  if (!(hand.confidence >= 0 && hand.confidence <= 1) || !is_point(hand.palm) || !is_unit(hand.direction) ||
      !is_unit(hand.normal) || !is_point(hand.wrist))
    return false;
  for (const auto& finger : hand.bones) {
    for (const LeapBone& bone : finger) {
      if (!is_point(bone.from) || !is_point(bone.to) || !(bone.width >= 0 && bone.width <= kWidest)) return false;
      if (hand.has_bones && !is_unit(bone.dorsal)) return false;
    }
  }
  return true;
}

void add_hand(LeapFrame& frame, const LeapHand& hand) {
  for (std::size_t i = 0; i < frame.hand_count; ++i) {
    if (frame.hands[i].side != hand.side) continue;
    if (hand.confidence > frame.hands[i].confidence) frame.hands[i] = hand;
    return;
  }
  frame.hands[frame.hand_count++] = hand;
}

LeapDecoder::LeapDecoder(const HandModel& hand, bool is_on_headset)
    : lifters_{LandmarkLifter(hand, Side::left), LandmarkLifter(hand, Side::right)},
      wrist_to_knuckle_{wrist_to_knuckle(hand, Side::left), wrist_to_knuckle(hand, Side::right)} {
  hand_.frame = is_on_headset ? kHeadset : kDesk;
}

void LeapDecoder::take(const Arrival& packet, TrackerSink& out) { refusals_.accepted(take_frame(packet, out)); }

LeapRefusal LeapDecoder::take_frame(const Arrival& packet, TrackerSink& out) {
  std::memcpy(&frame_, packet.bytes.data(), sizeof frame_);
  if (frame_.refusal != LeapRefusal::none) return frame_.refusal;
  if (packet.connection != connection_) {
    connection_ = packet.connection;
    clock_ = {};
    sent_.reset();
  }
  Nanoseconds time = frame_.time;
  if (!frame_.has_our_time) {
    if (clock_.add(frame_.time, packet.time)) sent_.reset();
    time = clock_.map(frame_.time);
  }
  // A time far ahead would make all later frames old.
  if (frame_.has_our_time && !age_of(time, packet.time)) return LeapRefusal::content;
  if (sent_ && frame_.time <= *sent_) return LeapRefusal::order;
  sent_ = frame_.time;
  time = std::min(time, packet.time);
  LeapRefusal refusal = LeapRefusal::none;
  for (std::uint32_t side = 0; side < 2; ++side) {
    const auto end = frame_.hands.begin() + frame_.hand_count;
    const auto seen = std::find_if(frame_.hands.begin(), end, [&](const LeapHand& hand) { return hand.side == side; });
    if (seen != end && !(seen->has_bones ? use_bones(*seen) : use_landmarks(*seen))) {
      refusal = LeapRefusal::shape;
      continue;
    }
    hand_.hand.side = side;
    hand_.confidence = seen != end ? seen->confidence : 0;
    stamps_.stamp(side, time, hand_.stamp);
    out.hand(hand_);
  }
  return refusal;
}

bool LeapDecoder::use_bones(const LeapHand& hand) {
  const auto palm = orientation_of(to_vector(hand.direction), -to_vector(hand.normal));
  if (!palm) return false;
  const auto set = [&](Joint joint, const Vec3& position, const Quaternion& orientation, double width) {
    JointSample& sample = hand_.joints[slot_of(joint)];
    sample.position = position;
    sample.orientation = to_wire(orientation);
    sample.radius = width / 2;
    sample.flags = kJointValid | kJointTracked;
  };
  set(Joint::wrist, hand.wrist, *palm, 0);
  for (int finger = 0; finger < kFingerCount; ++finger) {
    const Joint tip = tip_of(static_cast<Finger>(finger));
    // The thumb's metacarpal is its second bone.
    for (int k = finger == 0 ? 1 : 0; k < 4; ++k) {
      const LeapBone& bone = hand.bones[static_cast<std::size_t>(finger)][static_cast<std::size_t>(k)];
      const Vector3 along = to_vector(bone.to) - to_vector(bone.from);
      const auto turn = orientation_of(along, to_vector(bone.dorsal));
      if (!(along.norm() > kShortest) || !turn) return false;
      set(static_cast<Joint>(index_of(tip) - 4 + k), bone.from, *turn, bone.width);
      if (k == 3) set(tip, bone.to, *turn, bone.width);
    }
  }
  const Pose centre = palm_between(to_pose(hand_.joints[slot_of(Joint::middle_metacarpal)]),
                                   to_pose(hand_.joints[slot_of(Joint::middle_proximal)]));
  set(Joint::palm, to_wire(centre.position), centre.orientation, 0);
  hand_.joints[slot_of(Joint::palm)].flags = kJointValid | kJointInferred;
  return true;
}

bool LeapDecoder::use_landmarks(const LeapHand& hand) {
  const auto palm = orientation_of(to_vector(hand.direction), -to_vector(hand.normal));
  if (!palm) return false;
  Landmarks points;
  for (std::size_t finger = 0; finger < kFingerCount; ++finger) {
    const auto& bones = hand.bones[finger];
    for (std::size_t k = 0; k < 3; ++k) points[1 + 4 * finger + k] = to_vector(bones[k + 1].from);
    points[4 + 4 * finger] = to_vector(bones[3].to);
  }
  // The wrist is as far behind the knuckle of the middle finger as that of the scene's hand.
  points[0] = points[9] - *palm * wrist_to_knuckle_[hand.side];
  if (!lifters_[hand.side].lift(points, hand_)) return false;
  hand_.joints[slot_of(Joint::wrist)].flags = kJointValid | kJointInferred;
  return true;
}

}  // namespace softhand
