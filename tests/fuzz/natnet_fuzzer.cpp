// Packets of OptiTrack's Motive (services/trackers/natnet/README.md).
#include "fuzz/tracker_fuzzer.hpp"
#include "trackers/natnet/simulated_motive.hpp"

namespace softhand::fuzz {
namespace {

MotiveDecoder fresh_decoder() {
  NatNetOptions options;
  options.skeleton = "Actor";
  options.bones = "local";
  options.left.body = 1;
  options.head.body = 3;
  return {shipped_hand(), options};
}

}  // namespace

// The first byte is the version of the server. Then follow packets, each after its header.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  static const MotiveDecoder fresh = fresh_decoder();
  MotiveDecoder decoder = fresh;
  CheckedSink sink;
  const auto take = [&](std::string_view packet) { decoder.take({packet, kArrival, 0, false}, sink); };
  const NatNetVersion version{3 + (data[0] >> 4) % 2, data[0] % 2};
  take(motive_server_info(version, 10'000'000));
  std::string_view rest(reinterpret_cast<const char*>(data + 1), size - 1);
  while (rest.size() >= 4) {
    PacketReader<std::endian::little> header(rest.substr(2));
    const std::size_t packet = std::min(rest.size(), std::size_t{4} + header.read<std::uint16_t>());
    take(rest.substr(0, packet));
    rest.remove_prefix(packet);
  }
  decoder.speak(kArrival, [](std::string_view word) { expect(read_natnet(word).has_value(), "words have a header"); });
  return 0;
}

}  // namespace softhand::fuzz
