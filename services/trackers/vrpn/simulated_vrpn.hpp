// What a VRPN server sends. For its simulator and for tests.
#pragma once

#include <bit>
#include <cstdint>
#include <string>
#include <string_view>

#include "device/packet_bytes.hpp"
#include "trackers/vrpn/vrpn_message.hpp"

namespace softhand {

namespace vrpn_detail {
using Writer = PacketWriter<std::endian::big>;
}

/// A message with its padding. `sent` is on the server's clock.
inline std::string vrpn_message(std::int32_t type, std::int32_t sender, Nanoseconds sent, std::string_view payload) {
  vrpn_detail::Writer out;
  out.add(static_cast<std::int32_t>(kVrpnHeader + payload.size()));
  out.add(static_cast<std::int32_t>(sent / 1'000'000'000)).add(static_cast<std::int32_t>(sent / 1000 % 1'000'000));
  out.add(sender).add(type).add(std::int32_t{0});
  return out.add_padded(payload, (payload.size() + 7) / 8 * 8).bytes;
}
/// Names a sender (`VrpnMessage::kSender`) or a type.
inline std::string vrpn_name(std::int32_t kind, std::int32_t number, std::string_view name) {
  vrpn_detail::Writer out;
  out.add(static_cast<std::int32_t>(name.size() + 1)).add_text(name);
  return vrpn_message(kind, number, 0, out.bytes);
}
inline std::string vrpn_pose(std::int32_t type, std::int32_t sender, Nanoseconds sent, std::int32_t sensor,
                             const Pose& pose) {
  vrpn_detail::Writer out;
  out.add(sensor).add(std::int32_t{0});
  for (const double value : pose.position) out.add(value);
  for (const double value : pose.orientation.coeffs()) out.add(value);
  return vrpn_message(type, sender, sent, out.bytes);
}

/// What a server says first, with sender 3 = "Tracker0" and type 5 = poses, among others.
inline std::string vrpn_greeting() {
  return vrpn_cookie() + vrpn_name(VrpnMessage::kSender, 0, "VRPN Control") +
         vrpn_name(VrpnMessage::kSender, 3, "Tracker0") + vrpn_name(VrpnMessage::kType, 4, "vrpn_Tracker Velocity") +
         vrpn_name(VrpnMessage::kType, 5, kVrpnPoseType);
}

}  // namespace softhand
