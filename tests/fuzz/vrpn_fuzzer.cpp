// Streams of a VRPN server (services/trackers/vrpn/README.md).
#include "fuzz/tracker_fuzzer.hpp"
#include "trackers/vrpn/vrpn_server.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  VrpnOptions options;
  options.left.sensor = options.head.sensor = 0;
  options.right.sensor = 1;
  VrpnDecoder decoder(options);
  CheckedSink sink;
  std::string_view rest(reinterpret_cast<const char*>(data), size);
  while (!rest.empty()) {
    const std::size_t packet = vrpn_packet_size(rest);
    if (packet == 0 || packet > rest.size()) break;
    decoder.take({rest.substr(0, packet), kArrival, 1, false}, sink);
    rest.remove_prefix(packet);
  }
  // Damaged packets that are no longer divided by their own sizes.
  if (size > kVrpnHeader) decoder.take({{reinterpret_cast<const char*>(data), size}, kArrival, 1, false}, sink);
  return 0;
}

}  // namespace softhand::fuzz
