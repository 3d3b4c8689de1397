// Messages of VRPN 7 over TCP. Nothing here allocates, except the cookie.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "math/types.hpp"
#include "messages/messages.hpp"

namespace softhand {

inline constexpr std::size_t kLargestVrpnMessage = 8192;  ///< bytes; those of trackers have about 100
inline constexpr std::size_t kVrpnSlots = 256;            ///< one for each message of each sensor
inline constexpr std::size_t kVrpnHeader = 24;            ///< bytes of a header, and of a cookie

/// What client and server say first. 24 bytes.
std::string vrpn_cookie();
/// True if the bytes are the cookie of VRPN 7.
bool is_vrpn_cookie(std::string_view bytes);

/// Size of the first packet of a stream: a cookie, or a message with its padding (device/intake.hpp).
std::size_t vrpn_packet_size(std::string_view bytes);

struct VrpnMessage {
  static constexpr std::int32_t kSender = -1, kType = -2;  ///< types of messages that name a sender or a type

  Nanoseconds sent = 0;  ///< the server's clock; 0 = unknown
  std::int32_t sender = 0;
  std::int32_t type = 0;
  std::string_view payload;
};
/// Empty if the packet is not one message with its padding, or if its time is none.
std::optional<VrpnMessage> read_vrpn(std::string_view packet);

/// The text of a message that names a sender or a type. Empty if the payload is none.
std::string_view read_vrpn_name(std::string_view payload);

inline constexpr std::string_view kVrpnPoseType = "vrpn_Tracker Pos_Quat";
struct VrpnPose {
  std::int32_t sensor = 0;
  Pose pose;  ///< units and axes of the server
};
std::optional<VrpnPose> read_vrpn_pose(std::string_view payload);

}  // namespace softhand
