// UDP packets of a capture file (pcapng, Ethernet, IPv4), and other captured files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "device/packet_bytes.hpp"
#include "messages/messages.hpp"

namespace softhand::testing {

/// Captured data are not part of this project, so tests that need them are skipped without them.
inline std::string captured_path(const std::string& name) { return SOFTHAND_SOURCE_DIR "/../shared/data/" + name; }
inline bool has_captured(const std::string& name) { return std::filesystem::exists(captured_path(name)); }
inline std::string captured(const std::string& name) {
  std::ifstream in(captured_path(name), std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

struct CapturedPacket {
  Nanoseconds time = 0;
  int from = 0, to = 0;  ///< ports
  std::string payload;
};

/// The UDP packets of a file with times in microseconds. Others are left out.
inline std::vector<CapturedPacket> captured_packets(const std::string& name) {
  std::vector<CapturedPacket> out;
  const std::string file = captured(name);
  PacketReader<std::endian::little> blocks(file);
  while (blocks.good() && !blocks.at_end()) {
    const auto type = blocks.read<std::uint32_t>();
    const auto size = blocks.read<std::uint32_t>();
    PacketReader<std::endian::little> block(blocks.take(size - 8));
    if (type != 6) continue;  // an enhanced packet
    block.take(4);
    const auto high = block.read<std::uint32_t>(), low = block.read<std::uint32_t>();
    const auto captured_size = block.read<std::uint32_t>();
    block.take(4);  // size on the wire
    const std::string_view packet = block.take(captured_size);
    constexpr std::size_t kEthernet = 14, kUdp = 8;
    if (packet.size() < kEthernet + 20 || packet.substr(12, 2) != std::string_view("\x08\0", 2) || packet[23] != 17)
      continue;
    PacketReader<std::endian::big> udp(packet.substr(kEthernet + 4 * (static_cast<std::size_t>(packet[14]) & 15)));
    CapturedPacket each;
    each.time = static_cast<Nanoseconds>(std::uint64_t{high} << 32 | low) * 1000;
    each.from = udp.read<std::uint16_t>();
    each.to = udp.read<std::uint16_t>();
    const std::size_t size_of_udp = udp.read<std::uint16_t>();
    udp.take(2);
    each.payload = udp.take(size_of_udp - kUdp);
    out.push_back(each);
  }
  return out;
}

}  // namespace softhand::testing
