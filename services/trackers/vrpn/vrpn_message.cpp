#include "trackers/vrpn/vrpn_message.hpp"

#include <bit>
#include <limits>

#include "device/packet_bytes.hpp"

namespace softhand {
namespace {

using Reader = PacketReader<std::endian::big>;

constexpr std::size_t padded(std::size_t size) { return (size + 7) / 8 * 8; }

}  // namespace

std::string vrpn_cookie() {
  std::string cookie = "vrpn: ver. 07.35  0";  // no remote logging
  cookie.resize(kVrpnHeader, '\0');
  return cookie;
}

bool is_vrpn_cookie(std::string_view bytes) {
  return bytes.size() == kVrpnHeader && bytes.starts_with("vrpn: ver. 07.");
}

std::size_t vrpn_packet_size(std::string_view bytes) {
  if (bytes.size() < 4) return 0;
  if (bytes.starts_with("vrpn")) return kVrpnHeader;  // as a length this is 1.9 GB
  const std::size_t size = Reader(bytes).read_count();
  return size < kVrpnHeader ? std::numeric_limits<std::size_t>::max() : padded(size);
}

std::optional<VrpnMessage> read_vrpn(std::string_view packet) {
  Reader in(packet);
  VrpnMessage message;
  const std::size_t size = in.read_count();
  const auto seconds = in.read<std::int32_t>(), microseconds = in.read<std::int32_t>();
  message.sender = in.read<std::int32_t>();
  message.type = in.read<std::int32_t>();
  in.take(4);
  if (!in.good() || size < kVrpnHeader || padded(size) != packet.size()) return std::nullopt;
  if (seconds < 0 || microseconds < 0 || microseconds >= 1'000'000) return std::nullopt;
  message.sent = seconds * Nanoseconds{1'000'000'000} + microseconds * Nanoseconds{1000};
  message.payload = in.take(size - kVrpnHeader);
  return message;
}

std::string_view read_vrpn_name(std::string_view payload) {
  Reader in(payload);
  std::string_view name = in.take(in.read_count());
  if (!in.at_end()) return {};
  // VRPN's own server counts the zero at the end.
  return name.substr(0, name.find('\0'));
}

std::optional<VrpnPose> read_vrpn_pose(std::string_view payload) {
  Reader in(payload);
  VrpnPose out;
  out.sensor = in.read<std::int32_t>();
  in.take(4);
  for (double& value : out.pose.position) value = in.read<double>();
  for (double& value : out.pose.orientation.coeffs()) value = in.read<double>();
  if (!in.at_end()) return std::nullopt;
  return out;
}

}  // namespace softhand
