// Streams of bytes that are divided into packets (common/device/packet_splitter.hpp).
#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "device/packet_splitter.hpp"
#include "fuzz/fuzzer.hpp"
#include "trackers/vrpn/vrpn_message.hpp"

namespace softhand::fuzz {
namespace {

struct Packets {
  std::vector<std::string> list;
  int refused = 0;
  bool goes_on = true;
  bool is_within_packet = false;
  bool operator==(const Packets&) const = default;
};

// Of a stream that comes in parts of these sizes, over and over.
Packets divide(Framing framing, std::size_t largest, std::string_view bytes, const std::vector<std::size_t>& parts) {
  Packets out;
  PacketSplitter splitter(framing, largest);
  for (std::size_t i = 0; !bytes.empty() && out.goes_on; ++i) {
    const std::string_view part = bytes.substr(0, parts[i % parts.size()]);
    bytes.remove_prefix(part.size());
    out.goes_on = splitter.take(
        part, [&](std::string_view packet) { out.list.emplace_back(packet); }, [&] { ++out.refused; });
  }
  out.is_within_packet = splitter.is_within_packet();
  return out;
}

// A packet begins with its size, up to 65535 bytes.
std::size_t size_of_first(std::string_view bytes) {
  std::uint16_t size = 0;
  if (bytes.size() < sizeof size) return 0;
  std::memcpy(&size, bytes.data(), sizeof size);
  return std::max<std::size_t>(size, sizeof size);
}

}  // namespace

// The first bytes: framing, largest packet, and how the stream comes in parts.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::size_t kHead = 4;
  if (size < kHead) return 0;
  const std::size_t largest = 16 + data[1];
  const Framing framing = data[0] % 3 == 0   ? Framing('~')
                          : data[0] % 3 == 1 ? Framing(size_of_first)
                                             : Framing(vrpn_packet_size);
  const std::string_view bytes(reinterpret_cast<const char*>(data) + kHead, size - kHead);
  const Packets whole = divide(framing, largest, bytes, {size});
  for (const std::string& packet : whole.list) expect(packet.size() <= largest, "a packet has at most this size");
  expect(whole.goes_on || whole.refused == 1, "a stream ends with a refusal");
  const Packets parts = divide(framing, largest, bytes, {1u + data[2], 1u + data[3] % 8u});
  expect(parts == whole, "the parts in which a stream comes change nothing");
  return 0;
}

}  // namespace softhand::fuzz
