#include "trackers/osc/performer.hpp"

#include <algorithm>
#include <cmath>

#include "device/body_mount.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

constexpr double kFarthest = 1000;  // m
constexpr double kPerDegree = M_PI / 180;
constexpr Nanoseconds kHalves = 5'000'000;      // position and rotation of one pose arrive within this time
constexpr Nanoseconds kTogether = 100'000'000;  // a wrist and curls within this time are one hand
constexpr std::uint32_t kAllFresh = (1u << (1 + kFingerBones)) - 1;

bool skip(std::string_view& text, std::string_view prefix) {
  if (!text.starts_with(prefix)) return false;
  text.remove_prefix(prefix.size());
  return true;
}

bool is_place(const Vector3& v) { return v.cwiseAbs().maxCoeff() <= kFarthest; }

// A position and a quaternion xyzw.
bool to_pose(const OscMessage& message, Pose& out) {
  if (message.count < 7) return false;
  std::array<double, 7> v;
  std::copy_n(message.numbers.begin(), 7, v.begin());
  if (!all_finite(v)) return false;
  out.position = Vector3(v[0], v[1], v[2]);
  out.orientation = Quaternion(v[6], v[3], v[4], v[5]);
  return make_plausible(out);
}

// Unity is left-handed with +Z forward. The world's -Z is forward.
bool from_unity(const OscMessage& message, Pose& out) {
  if (!to_pose(message, out)) return false;
  out.position.z() = -out.position.z();
  out.orientation.x() = -out.orientation.x();
  out.orientation.y() = -out.orientation.y();
  return true;
}

// Moves a hand whose wrist is at the origin to a wrist in the world.
void place_on_wrist(const Pose& wrist, Skeleton& out) {
  out.frame = 0;
  for (JointSample& joint : out.joints) {
    const Pose pose = wrist * Pose{to_vector(joint.position), to_quaternion(joint.orientation)};
    joint.position = to_wire(pose.position);
    joint.orientation = to_wire(pose.orientation);
  }
  out.joints[slot_of(Joint::wrist)].flags = kJointValid | kJointTracked;
}

}  // namespace

PerformerDecoder::PerformerDecoder(const HandModel& hand, const OscOptions& options)
    : wrist_trackers_{options.left_tracker, options.right_tracker},
      lifters_{LandmarkLifter(hand, Side::left), LandmarkLifter(hand, Side::right)},
      curl_lifters_{CurlLifter(hand, Side::left), CurlLifter(hand, Side::right)} {
  for (JointSample& joint : curled_hand_.joints) joint.confidence = 1;
}

void PerformerDecoder::take(const Arrival& packet, TrackerSink& out) {
  const auto take_one = [&](const OscMessage& message) { refusals_.accepted(take_message(message, packet.time, out)); };
  if (!read_osc(packet.bytes, std::ref(take_one))) refusals_.accepted(OscRefusal::format);
}

OscRefusal PerformerDecoder::take_message(const OscMessage& message, Nanoseconds time, TrackerSink& out) {
  std::string_view address = message.address;
  if (skip(address, "/tracking/trackers/")) return take_tracker(address, message, time, out);
  if (skip(address, "/hand/")) return take_plain(address, message, time, out);
  if (!skip(address, "/VMC/Ext/")) return OscRefusal::none;
  if (address == "T") {
    // A new frame. A hand of the last frame that lacks bones would mix two frames.
    bool lacks_bones = false;
    for (Hand& hand : hands_) {
      lacks_bones = lacks_bones || (hand.fresh != 0 && hand.seen);
      hand.fresh = 0;
    }
    return lacks_bones ? OscRefusal::incomplete : OscRefusal::none;
  }
  const bool is_bone = address == "Bone/Pos", is_root = address == "Root/Pos", is_head = address == "Hmd/Pos";
  if (!is_bone && !is_root && !is_head) return OscRefusal::none;
  Pose pose;
  if (!from_unity(message, pose)) return OscRefusal::content;
  if (is_bone) return take_bone(message.text, pose, time, out);
  if (is_root) {
    root_ = pose;
  } else {
    deliver_head(pose, time, out);
  }
  return OscRefusal::none;
}

OscRefusal PerformerDecoder::take_bone(std::string_view name, const Pose& local, Nanoseconds time, TrackerSink& out) {
  if (const auto found = std::find(kTrunkNames.begin(), kTrunkNames.end(), name); found != kTrunkNames.end()) {
    trunk_[static_cast<std::size_t>(found - kTrunkNames.begin())] = local;
    return OscRefusal::none;
  }
  const bool is_left = skip(name, "Left");
  if (!is_left && !skip(name, "Right")) return OscRefusal::none;
  const auto found = std::find(kHandNames.begin(), kHandNames.end(), name);
  if (found == kHandNames.end()) return OscRefusal::none;
  const std::size_t side = is_left ? 0 : 1;
  Hand& hand = hands_[side];
  const auto bone = static_cast<std::size_t>(found - kHandNames.begin());
  hand.bones[bone] = local;
  if (bone + 1 < kArmBones) return OscRefusal::none;
  hand.fresh |= 1u << (bone + 1 - kArmBones);
  hand.seen = hand.seen || bone >= kArmBones;
  return hand.fresh == kAllFresh ? deliver_hand(side, time, out) : OscRefusal::none;
}

OscRefusal PerformerDecoder::deliver_hand(std::size_t side, Nanoseconds time, TrackerSink& out) {
  Hand& hand = hands_[side];
  hand.fresh = 0;
  Pose wrist = root_;
  for (const Pose& bone : trunk_) wrist = wrist * bone;
  for (std::size_t i = 0; i < kArmBones; ++i) wrist = wrist * hand.bones[i];
  // Only the places of the bones are used: the axes of an avatar's bones differ from avatar to avatar.
  HandBones bones{wrist, {}};
  for (std::size_t finger = 0; finger < kFingerCount; ++finger) {
    Pose bone = wrist;
    for (std::size_t k = 0; k < 3; ++k) {
      bone = bone * hand.bones[kArmBones + 3 * finger + k];
      bones.fingers[finger][k] = bone;
    }
  }
  if (!lifters_[side].lift(bones, hand_)) return OscRefusal::shape;
  deliver(hand_, side, time, out);
  return OscRefusal::none;
}

OscRefusal PerformerDecoder::take_plain(std::string_view address, const OscMessage& message, Nanoseconds time,
                                        TrackerSink& out) {
  const bool is_left = skip(address, "left/");
  if (!is_left && !skip(address, "right/")) return OscRefusal::none;
  const std::size_t side = is_left ? 0 : 1;
  PlainHand& hand = plain_hands_[side];
  if (address == "wrist") {
    Pose wrist;
    if (!to_pose(message, wrist)) return OscRefusal::content;
    hand.alone_since = time;
    if (time - hand.curls_time > kTogether) {
      set_wrist(wrist, hand_);
      deliver(hand_, side, time, out);
    } else {
      curl_lifters_[side].lift(hand.fingers, curled_hand_);
      place_on_wrist(wrist, curled_hand_);
      deliver(curled_hand_, side, time, out);
    }
    return OscRefusal::none;
  }
  const bool is_curls = address == "curls";
  if (!is_curls && address != "splays") return OscRefusal::none;
  const std::array<double, kFingerCount> v{message.numbers[0], message.numbers[1], message.numbers[2],
                                           message.numbers[3], message.numbers[4]};
  if (message.count < v.size() || !all_finite(v)) return OscRefusal::content;
  for (std::size_t f = 0; f < kFingerCount; ++f) {
    if (is_curls) {
      hand.fingers[f].curl.fill(v[f]);
      hand.fingers[f].valid = true;
    } else {
      hand.fingers[f].splay = v[f];
    }
  }
  if (!is_curls) return OscRefusal::none;
  // The next wrist brings them. After a gap it may be on its way.
  if (time - hand.curls_time > kTogether) hand.alone_since = time;
  hand.curls_time = time;
  if (time - hand.alone_since <= kTogether) return OscRefusal::none;
  curl_lifters_[side].lift(hand.fingers, curled_hand_);
  deliver(curled_hand_, side, time, out);
  return OscRefusal::none;
}

void PerformerDecoder::deliver(Skeleton& hand, std::size_t side, Nanoseconds time, TrackerSink& out) {
  hand.hand.side = static_cast<std::uint32_t>(side);
  hand.confidence = 1;
  stamps_.stamp(side, time, hand.stamp);
  out.hand(hand);
}

OscRefusal PerformerDecoder::take_tracker(std::string_view address, const OscMessage& message, Nanoseconds time,
                                          TrackerSink& out) {
  std::size_t number = 0;
  if (!skip(address, "head")) {
    if (address.empty() || address[0] < '1' || address[0] > '8') return OscRefusal::none;
    number = static_cast<std::size_t>(address[0] - '0');
    address.remove_prefix(1);
  }
  const bool is_position = address == "/position";
  if (!is_position && address != "/rotation") return OscRefusal::none;
  const std::array<double, 3> v{message.numbers[0], message.numbers[1], message.numbers[2]};
  if (message.count < 3 || !all_finite(v)) return OscRefusal::content;
  Tracker& tracker = trackers_[number];
  // The other half of an older pose was lost.
  if (time - tracker.time > kHalves) tracker.has_position = tracker.has_rotation = false;
  tracker.time = time;
  if (is_position) {
    if (!is_place(Vector3(v[0], v[1], v[2]))) return OscRefusal::content;
    tracker.pose.position = Vector3(v[0], v[1], -v[2]);
    tracker.has_position = true;
  } else {
    // Degrees about Unity's axes, Z first, then X, then Y. In right-handed axes the angles about x and y are negative.
    const auto turn = [](double degrees, const Vector3& axis) {
      return Quaternion(Eigen::AngleAxisd(degrees * kPerDegree, axis));
    };
    tracker.pose.orientation =
        turn(-v[1], Vector3::UnitY()) * turn(-v[0], Vector3::UnitX()) * turn(v[2], Vector3::UnitZ());
    tracker.has_rotation = true;
  }
  if (!tracker.has_position || !tracker.has_rotation) return OscRefusal::none;
  tracker.has_position = tracker.has_rotation = false;
  if (number == 0) {
    deliver_head(tracker.pose, time, out);
    return OscRefusal::none;
  }
  for (std::size_t side = 0; side < 2; ++side) {
    if (wrist_trackers_[side] != static_cast<std::int64_t>(number)) continue;
    set_wrist(tracker.pose, hand_);
    deliver(hand_, side, time, out);
  }
  return OscRefusal::none;
}

void PerformerDecoder::deliver_head(const Pose& pose, Nanoseconds time, TrackerSink& out) {
  head_.position = to_wire(pose.position);
  head_.orientation = to_wire(pose.orientation);
  head_.valid = 1;
  stamps_.stamp(SampleStamps::kHead, time, head_.stamp);
  out.head(head_);
}

}  // namespace softhand
