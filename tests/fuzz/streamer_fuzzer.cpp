// Datagrams and lines of Hand Tracking Streamer (services/trackers/streamer/README.md).
#include "fuzz/tracker_fuzzer.hpp"
#include "trackers/streamer/streamer.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const StreamerDecoder fresh(shipped_hand());
  StreamerDecoder decoder = fresh;
  CheckedSink sink;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  decoder.take({bytes, kArrival, 0, false}, sink);
  for_each_line(bytes, [&](const Arrival& line) { decoder.take(line, sink); });
  return 0;
}

}  // namespace softhand::fuzz
