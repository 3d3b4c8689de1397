// Packets of NatNet 3.0 to 4.1, OptiTrack's protocol. Nothing here allocates.
#pragma once

#include <compare>
#include <cstdint>
#include <functional>
#include <optional>
#include <string_view>

#include "math/types.hpp"

namespace softhand {

inline constexpr std::size_t kLargestNatNetPacket = 65507;  ///< bytes, of a datagram

struct NatNetVersion {
  int major = 0, minor = 0;
  auto operator<=>(const NatNetVersion&) const = default;
};
inline constexpr NatNetVersion kOldestNatNet{3, 0}, kNewestNatNet{4, 1};

enum class NatNetMessage : std::uint16_t {
  connect = 0,
  server_info = 1,
  request = 2,
  response = 3,
  request_models = 4,
  models = 5,
  request_frame = 6,
  frame = 7,
  text = 8,
  disconnect = 9,
  keep_alive = 10,
  timeout = 11,
  echo_request = 12,
  echo_response = 13,
  discovery = 14,
  unrecognised = 100,
};

struct NatNetPacket {
  NatNetMessage message;
  std::string_view payload;
};
/// Empty if the header does not state the size of the packet.
std::optional<NatNetPacket> read_natnet(std::string_view packet);

struct NatNetServer {
  NatNetVersion version;
  std::uint64_t ticks_per_second = 0;
};
std::optional<NatNetServer> read_server_info(std::string_view payload);

/// A rigid body, or a bone. The pose is as sent: neither axes nor numbers are checked.
struct NatNetBody {
  std::int32_t id = 0;
  Pose pose;
  bool is_tracked = false;
};
/// Bodies in the bytes of a packet.
class NatNetBodies {
 public:
  static constexpr std::size_t kSize = 38;  ///< bytes of a body
  explicit NatNetBodies(std::string_view bytes = {}) : bytes_(bytes) {}
  std::size_t size() const { return bytes_.size() / kSize; }
  NatNetBody operator[](std::size_t i) const;

 private:
  std::string_view bytes_;
};

inline constexpr std::uint16_t kNatNetModelsChanged = 2, kNatNetBitstreamChanged = 8;

/// Views into a packet.
struct NatNetFrame {
  std::int32_t number = 0;
  std::size_t marker_sets = 0, other_markers = 0, labelled_markers = 0, force_plates = 0, devices = 0, assets = 0;
  NatNetBodies bodies;
  std::size_t skeleton_count = 0;
  std::string_view skeletons;
  double time = 0;                                         ///< s since the start of the take or the server
  std::uint64_t exposure = 0, received = 0, transmit = 0;  ///< ticks of the server; 0 = unknown
  std::uint16_t parameters = 0;

  /// The bones of a skeleton, whose IDs are then those of the definition. Empty if the frame lacks it.
  NatNetBodies skeleton(std::int32_t id) const;
};
/// Empty if the payload is not a frame of this version to its last byte.
std::optional<NatNetFrame> read_frame(std::string_view payload, NatNetVersion version);

/// A bone of a skeleton, from the model definitions.
struct NatNetBone {
  std::string_view skeleton, name;
  std::int32_t skeleton_id = 0, id = 0, parent = 0;  ///< parent 0: none
};
/// Calls `take` for each bone of each skeleton, in order. Returns false, and calls nothing, if the payload is not a
/// list of model definitions of this version to its last byte.
bool read_models(std::string_view payload, NatNetVersion version, const std::function<void(const NatNetBone&)>& take);

}  // namespace softhand
