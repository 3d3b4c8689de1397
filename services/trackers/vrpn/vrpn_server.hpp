// Wrists and a head from the messages of a VRPN server (README.md).
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "device/arrival_queue.hpp"
#include "device/clock_mapping.hpp"
#include "device/refusals.hpp"
#include "device/sample_stamps.hpp"
#include "device/tracker_source.hpp"
#include "trackers/vrpn/vrpn_message.hpp"
#include "trackers/vrpn/vrpn_options.hpp"

namespace softhand {

enum class VrpnRefusal : std::uint8_t { none, version, format, content, order };
inline constexpr std::array<std::string_view, 5> kVrpnRefusalNames{"none", "version", "format", "content", "order"};

class VrpnDecoder {
 public:
  /// Throws std::invalid_argument if a mount is no pose.
  explicit VrpnDecoder(const VrpnOptions& options);

  /// A message with its padding, or the server's cookie. Does not allocate.
  void take(const Arrival& packet, TrackerSink& out);
  const Refusals<VrpnRefusal, kVrpnRefusalNames.size()>& refusals() const { return refusals_; }

 private:
  struct Sensor {
    std::string tracker;
    std::int32_t number = -1;
    Pose mount;                          // of the wrist or head on the sensor
    std::optional<std::int32_t> sender;  // number of the tracker in this connection
    std::optional<Nanoseconds> sent;     // of the newest message, the server's clock
  };

  VrpnRefusal take_packet(const Arrival& packet, TrackerSink& out);
  VrpnRefusal take_pose(const VrpnMessage& message, Nanoseconds arrival, TrackerSink& out);
  void deliver(std::size_t track, const Pose& pose, Nanoseconds time, TrackerSink& out);

  const bool is_z_up_;
  const double scale_;
  std::array<Sensor, 3> sensors_;  // left, right, head
  std::uint64_t connection_ = 0;
  bool is_greeted_ = false;
  std::optional<std::int32_t> pose_type_;  // number of the type in this connection
  ClockMapping clock_;
  SampleStamps stamps_;
  Skeleton hand_;
  HeadPose head_;
  Refusals<VrpnRefusal, kVrpnRefusalNames.size()> refusals_{kVrpnRefusalNames};
};

}  // namespace softhand
