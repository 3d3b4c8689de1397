#include "trackers/vrpn/vrpn_server.hpp"

#include <algorithm>

#include "messages/convert.hpp"

namespace softhand {

VrpnDecoder::VrpnDecoder(const VrpnOptions& options) : is_z_up_(options.up_axis == "z"), scale_(options.scale) {
  const std::array<const VrpnSensorOptions*, 3> all{&options.left, &options.right, &options.head};
  for (std::size_t i = 0; i < all.size(); ++i)
    sensors_[i] = {all[i]->tracker, static_cast<std::int32_t>(all[i]->sensor), all[i]->mount.pose(), {}, {}};
}

void VrpnDecoder::take(const Arrival& packet, TrackerSink& out) { refusals_.accepted(take_packet(packet, out)); }

VrpnRefusal VrpnDecoder::take_packet(const Arrival& packet, TrackerSink& out) {
  if (packet.connection != connection_) {
    connection_ = packet.connection;
    is_greeted_ = false;
    pose_type_.reset();
    clock_ = {};
    for (Sensor& sensor : sensors_) sensor.sender.reset(), sensor.sent.reset();
  }
  if (!is_greeted_) {
    is_greeted_ = is_vrpn_cookie(packet.bytes);
    return is_greeted_ ? VrpnRefusal::none : VrpnRefusal::version;
  }
  const auto message = read_vrpn(packet.bytes);
  if (!message) return VrpnRefusal::format;
  if (message->type == VrpnMessage::kSender || message->type == VrpnMessage::kType) {
    const std::string_view name = read_vrpn_name(message->payload);
    if (name.empty()) return VrpnRefusal::format;
    if (message->type == VrpnMessage::kType) {
      if (name == kVrpnPoseType) pose_type_ = message->sender;
      return VrpnRefusal::none;
    }
    for (Sensor& sensor : sensors_)
      if (sensor.tracker == name) sensor.sender = message->sender;
    return VrpnRefusal::none;
  }
  return pose_type_ && message->type == *pose_type_ ? take_pose(*message, packet.time, out) : VrpnRefusal::none;
}

VrpnRefusal VrpnDecoder::take_pose(const VrpnMessage& message, Nanoseconds arrival, TrackerSink& out) {
  auto seen = read_vrpn_pose(message.payload);
  if (!seen) return VrpnRefusal::format;
  const auto is_wanted = [&](const Sensor& sensor) {
    return sensor.number >= 0 && sensor.number == seen->sensor && sensor.sender == message.sender;
  };
  if (std::none_of(sensors_.begin(), sensors_.end(), is_wanted)) return VrpnRefusal::none;
  Pose& pose = seen->pose;
  pose.position *= scale_;
  if (is_z_up_) pose = from_z_up(pose);
  if (!make_plausible(pose)) return VrpnRefusal::content;
  Nanoseconds time = arrival;
  if (message.sent != 0) {
    if (clock_.add(message.sent, arrival))
      for (Sensor& sensor : sensors_) sensor.sent.reset();
    time = std::min(clock_.map(message.sent), arrival);
  }
  // One sensor may be a wrist and the head at once.
  bool is_old = false;
  for (std::size_t track = 0; track < sensors_.size(); ++track) {
    Sensor& sensor = sensors_[track];
    if (!is_wanted(sensor)) continue;
    if (message.sent != 0 && sensor.sent && message.sent <= *sensor.sent) {
      is_old = true;
      continue;
    }
    sensor.sent = message.sent;
    deliver(track, pose * sensor.mount, time, out);
  }
  return is_old ? VrpnRefusal::order : VrpnRefusal::none;
}

void VrpnDecoder::deliver(std::size_t track, const Pose& pose, Nanoseconds time, TrackerSink& out) {
  if (track == SampleStamps::kHead) {
    head_.position = to_wire(pose.position);
    head_.orientation = to_wire(pose.orientation);
    head_.valid = 1;
    stamps_.stamp(track, time, head_.stamp);
    return out.head(head_);
  }
  set_wrist(pose, hand_);
  hand_.hand.side = static_cast<std::uint32_t>(track);
  stamps_.stamp(track, time, hand_.stamp);
  out.hand(hand_);
}

}  // namespace softhand
