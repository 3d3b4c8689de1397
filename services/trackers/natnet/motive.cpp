#include "trackers/natnet/motive.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

#include "device/packet_bytes.hpp"
#include "messages/convert.hpp"

namespace softhand {
namespace {

using Reader = PacketReader<std::endian::little>;
using Writer = PacketWriter<std::endian::little>;

constexpr std::int64_t kReordered = 100;              // frames; a number that is further back is a new start
constexpr Nanoseconds kOldestSample = 1'000'000'000;  // before its arrival

bool skip(std::string_view& text, std::string_view prefix) {
  if (!text.starts_with(prefix)) return false;
  text.remove_prefix(prefix.size());
  return true;
}

std::string connect_payload() {
  Writer out;
  out.add_padded("softhand", 256).add_padded("", 4);
  out.add(std::uint8_t{4}).add(std::uint8_t{1}).add(std::uint16_t{0});  // the newest version that is understood
  out.add(std::uint8_t{0}).add(std::uint32_t{0});                       // all data, in the version of the server
  return out.bytes;
}

}  // namespace

std::optional<BoneOfHand> bone_of_hand(std::string_view name) {
  BoneOfHand out{Side::left, -1, 0};
  if (skip(name, "Left")) {
    skip(name, "Hand");
  } else if (skip(name, "Right")) {
    out.side = Side::right;
    skip(name, "Hand");
  } else if (skip(name, "R")) {
    out.side = Side::right;
  } else if (!skip(name, "L")) {
    return std::nullopt;
  }
  if (name.empty() || name == "Hand") return out;
  constexpr std::array<std::string_view, 5> fingers{"Thumb", "Index", "Middle", "Ring", "Pinky"};
  for (const std::string_view finger : fingers) {
    ++out.finger;
    if (!skip(name, finger)) continue;
    if (name.size() != 1 || name[0] < '1' || name[0] > '3') return std::nullopt;
    out.joint = name[0] - '1';
    return out;
  }
  return std::nullopt;
}

std::string natnet_packet(NatNetMessage message, std::string_view payload) {
  Writer out;
  out.add(static_cast<std::uint16_t>(message)).add(static_cast<std::uint16_t>(payload.size()));
  return out.bytes + std::string(payload);
}

MotiveDecoder::MotiveDecoder(const HandModel& hand, const NatNetOptions& options)
    : is_multicast_(options.multicast),
      is_z_up_(options.up_axis == "z"),
      has_local_bones_(options.bones == "local"),
      skeleton_name_(options.skeleton),
      bodies_{Body{static_cast<std::int32_t>(options.left.body), options.left.mount.pose()},
              Body{static_cast<std::int32_t>(options.right.body), options.right.mount.pose()},
              Body{static_cast<std::int32_t>(options.head.body), options.head.mount.pose()}},
      connect_(natnet_packet(NatNetMessage::connect, connect_payload())),
      keep_alive_(natnet_packet(NatNetMessage::keep_alive, "")),
      request_models_(natnet_packet(NatNetMessage::request_models, "")),
      older_bitstream_(natnet_packet(NatNetMessage::request, std::string_view("Bitstream,4.1\0", 14))),
      echo_(natnet_packet(NatNetMessage::echo_request, std::string(8, '\0'))),
      lifters_{LandmarkLifter(hand, Side::left), LandmarkLifter(hand, Side::right)} {}

void MotiveDecoder::take(const Arrival& packet, TrackerSink& out) { refusals_.accepted(take_packet(packet, out)); }

MotiveRefusal MotiveDecoder::take_packet(const Arrival& packet, TrackerSink& out) {
  const auto natnet = read_natnet(packet.bytes);
  if (!natnet) return MotiveRefusal::size;
  if (natnet->message == NatNetMessage::server_info) return take_server_info(natnet->payload, packet.time);
  // The version of the server is needed to read anything else.
  const bool is_data = natnet->message == NatNetMessage::frame || natnet->message == NatNetMessage::models;
  if (!server_) return is_data ? MotiveRefusal::version : MotiveRefusal::none;
  switch (natnet->message) {
    case NatNetMessage::frame:
      return take_frame(natnet->payload, packet.time, out);
    case NatNetMessage::models:
      return take_models(natnet->payload);
    case NatNetMessage::echo_response:
      return take_echo(natnet->payload, packet.time);
    default:
      return MotiveRefusal::none;
  }
}

MotiveRefusal MotiveDecoder::take_server_info(std::string_view payload, Nanoseconds arrival) {
  const auto server = read_server_info(payload);
  if (!server) return MotiveRefusal::size;
  if (server->version < kOldestNatNet) return MotiveRefusal::version;
  // After a silence it is a server that was started again, with another clock.
  if (!server_ || server->version != server_->version || is_silent(arrival)) forget_server();
  server_ = server;
  shown_ = arrival;  // now it has time to send frames
  asks_version_ = false;
  wants_older_bitstream_ = server->version > kNewestNatNet;
  next_words_ = 0;
  return MotiveRefusal::none;
}

void MotiveDecoder::forget_server() {
  server_.reset();
  shown_ = 0;
  number_.reset();
  parameters_ = 0;
  clock_ = {};
  offset_.reset();
  skeleton_.reset();
  needs_models_ = !skeleton_name_.empty();
}

MotiveRefusal MotiveDecoder::take_models(std::string_view payload) {
  skeleton_.reset();
  hand_bones_ = {};
  parents_ = {};
  bool fits = true;
  const auto take = [&](const NatNetBone& bone) {
    if (bone.skeleton != skeleton_name_) return;
    skeleton_ = bone.skeleton_id;
    const auto is_bone = [](std::int32_t id) { return id >= 0 && static_cast<std::size_t>(id) < kMostBones; };
    if (bone.id == 0 || !is_bone(bone.id) || !is_bone(bone.parent)) {
      fits = false;
      return;
    }
    parents_[static_cast<std::size_t>(bone.id)] = bone.parent;
    std::string_view name = bone.name;
    // Motive puts the name of the skeleton before those of its bones.
    if (skip(name, skeleton_name_)) skip(name, "_");
    const auto place = bone_of_hand(name);
    if (!place) return;
    Hand& hand = hand_bones_[static_cast<std::size_t>(place->side)];
    if (place->finger < 0) {
      hand.wrist = bone.id;
    } else {
      hand.fingers[static_cast<std::size_t>(place->finger)][static_cast<std::size_t>(place->joint)] = bone.id;
    }
  };
  if (!read_models(payload, bitstream(), std::ref(take)) || !fits) {
    skeleton_.reset();
    return MotiveRefusal::models;
  }
  needs_models_ = false;
  return MotiveRefusal::none;
}

MotiveRefusal MotiveDecoder::take_echo(std::string_view payload, Nanoseconds arrival) {
  Reader in(payload);
  const auto sent = in.read<std::int64_t>();
  const Nanoseconds there = to_nanoseconds(in.read<std::uint64_t>());
  if (!in.at_end()) return MotiveRefusal::size;
  // An answer to nobody's question would be a false bound of the clock for many seconds.
  if (sent <= 0 || sent > arrival || arrival - sent > kSilence) return MotiveRefusal::content;
  clock_.answered(sent, there);
  clock_.heard(there, arrival);
  offset_ = clock_.at(arrival);
  offset_time_ = arrival;
  return MotiveRefusal::none;
}

MotiveRefusal MotiveDecoder::take_frame(std::string_view payload, Nanoseconds arrival, TrackerSink& out) {
  const auto frame = read_frame(payload, bitstream());
  if (!frame) {
    asks_version_ = true;
    return MotiveRefusal::size;
  }
  if (number_ && frame->number <= *number_) {
    if (frame->number > std::int64_t{*number_} - kReordered) return MotiveRefusal::order;
    // The server was started again, or a take was: the clock may be another one.
    forget_server();
    next_words_ = 0;
    return MotiveRefusal::none;
  }
  shown_ = arrival;
  number_ = frame->number;
  const std::uint16_t begun = frame->parameters & static_cast<std::uint16_t>(~parameters_);
  parameters_ = frame->parameters;
  if ((begun & kNatNetModelsChanged) != 0) needs_models_ = !skeleton_name_.empty();
  if ((begun & kNatNetBitstreamChanged) != 0) asks_version_ = true;
  if ((begun & (kNatNetModelsChanged | kNatNetBitstreamChanged)) != 0) next_words_ = 0;
  const Nanoseconds time = time_of(*frame, arrival);

  // The whole frame is read before anything is delivered.
  std::array<std::optional<Pose>, 3> poses;
  for (std::size_t i = 0; i < frame->bodies.size(); ++i) {
    const NatNetBody seen = frame->bodies[i];
    for (std::size_t track = 0; track < bodies_.size(); ++track) {
      if (bodies_[track].id == 0 || seen.id != bodies_[track].id || !seen.is_tracked) continue;
      const auto pose = to_world(seen.pose);
      if (!pose) return MotiveRefusal::content;
      poses[track] = *pose * bodies_[track].mount;
    }
  }
  if (!read_bones(skeleton_ ? frame->skeleton(*skeleton_) : NatNetBodies())) return MotiveRefusal::content;
  MotiveRefusal refusal = MotiveRefusal::none;
  for (std::size_t side = 0; side < 2; ++side) {
    hand_.hand.side = static_cast<std::uint32_t>(side);
    if (bodies_[side].id != 0) {
      set_wrist(poses[side].value_or(Pose{}), hand_);
      if (!poses[side]) hand_.confidence = 0;
    } else if (!skeleton_ || !hand_bones_[side].is_defined()) {
      continue;
    } else if (!lift_hand(side)) {
      refusal = MotiveRefusal::shape;
      continue;
    }
    stamps_.stamp(side, time, hand_.stamp);
    out.hand(hand_);
  }
  if (bodies_[SampleStamps::kHead].id != 0) {
    const auto& pose = poses[SampleStamps::kHead];
    head_.valid = pose ? 1 : 0;
    head_.position = to_wire(pose.value_or(Pose{}).position);
    head_.orientation = to_wire(pose.value_or(Pose{}).orientation);
    stamps_.stamp(SampleStamps::kHead, time, head_.stamp);
    out.head(head_);
  }
  return refusal;
}

bool MotiveDecoder::read_bones(NatNetBodies seen) {
  for (SeenBone& bone : bones_) bone = {};
  for (std::size_t i = 0; i < seen.size(); ++i) {
    const NatNetBody body = seen[i];
    const auto id = static_cast<std::size_t>(body.id & 0xffff);  // above it, the ID of the skeleton
    const auto pose = to_world(body.pose);
    if (id >= kMostBones || (!pose && body.is_tracked)) return false;
    bones_[id] = {pose.value_or(Pose{}), pose.has_value(), body.is_tracked};
  }
  return true;
}

bool MotiveDecoder::lift_hand(std::size_t side) {
  const Hand& hand = hand_bones_[side];
  HandBones bones;
  int tracked = 0, seen = 0;
  const auto take = [&](std::int32_t id, Joint joint, Pose& pose) {
    const auto place = bone_pose(id);
    if (!place) return;
    pose = *place;
    ++seen;
    const bool is_tracked = bones_[static_cast<std::size_t>(id)].is_tracked;
    tracked += is_tracked ? 1 : 0;
    hand_.joints[static_cast<std::size_t>(index_of(joint))].confidence = is_tracked ? 1 : kGuessedConfidence;
  };
  take(hand.wrist, Joint::wrist, bones.wrist);
  for (int finger = 0; finger < kFingerCount; ++finger) {
    const auto f = static_cast<std::size_t>(finger);
    const int first = index_of(tip_of(static_cast<Finger>(finger))) - 3;
    for (int k = 0; k < 3; ++k)
      take(hand.fingers[f][static_cast<std::size_t>(k)], static_cast<Joint>(first + k),
           bones.fingers[f][static_cast<std::size_t>(k)]);
  }
  constexpr int kBones = 1 + 3 * kFingerCount;
  const bool is_seen = seen == kBones && bones_[static_cast<std::size_t>(hand.wrist)].is_tracked;
  hand_.confidence = is_seen ? static_cast<double>(tracked) / kBones : 0;
  return !is_seen || lifters_[side].lift(bones, hand_);
}

bool MotiveDecoder::Hand::is_defined() const {
  return wrist != 0 && std::all_of(fingers.begin(), fingers.end(), [](const auto& finger) {
           return std::find(finger.begin(), finger.end(), 0) == finger.end();
         });
}

std::optional<Pose> MotiveDecoder::to_world(Pose pose) const {
  if (is_z_up_) pose = from_z_up(pose);
  if (!make_plausible(pose)) return std::nullopt;
  return pose;
}

std::optional<Pose> MotiveDecoder::bone_pose(std::int32_t id) const {
  Pose pose;
  // A chain cannot be longer than there are bones, unless the definitions are a circle.
  for (std::size_t i = 0; i < kMostBones; ++i) {
    const SeenBone& bone = bones_[static_cast<std::size_t>(id)];
    if (!bone.is_seen) return std::nullopt;
    pose = bone.pose * pose;
    id = parents_[static_cast<std::size_t>(id)];
    if (!has_local_bones_ || id == 0) return pose;
  }
  return std::nullopt;
}

Nanoseconds MotiveDecoder::to_nanoseconds(std::uint64_t ticks) const {
  const std::uint64_t rate = server_->ticks_per_second, seconds = ticks / rate;
  // Beyond a century the clock is absurd: no offset is computed from it.
  if (seconds > 3'000'000'000) return ClockOffset::kLatest + 1;
  return static_cast<Nanoseconds>(seconds * 1'000'000'000 + ticks % rate * 1'000'000'000 / rate);
}

Nanoseconds MotiveDecoder::time_of(const NatNetFrame& frame, Nanoseconds arrival) const {
  if (!offset_ || frame.exposure == 0) return arrival;
  const auto drifted = static_cast<Nanoseconds>(offset_->drift * static_cast<double>(arrival - offset_time_));
  const Nanoseconds time = to_nanoseconds(frame.exposure) + offset_->offset + drifted;
  // A recorded take has the times of its recording.
  return time > arrival - kOldestSample ? std::min(time, arrival) : arrival;
}

std::string_view MotiveDecoder::echo_request(Nanoseconds now) {
  std::memcpy(echo_.data() + 4, &now, sizeof now);
  return echo_;
}

}  // namespace softhand
