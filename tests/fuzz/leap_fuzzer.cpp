// Messages of an Ultraleap service (services/trackers/leap/README.md).
#include "fuzz/tracker_fuzzer.hpp"
#include "trackers/leap/leap_hands.hpp"
#include "trackers/leap/leap_message.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const LeapDecoder fresh(shipped_hand(), false);
  LeapDecoder decoder = fresh;
  CheckedSink sink;
  LeapFrame frame;
  if (!read_leap_message({reinterpret_cast<const char*>(data), size}, frame)) return 0;
  decoder.take({frame.bytes(), kArrival, 1, true}, sink);
  return 0;
}

}  // namespace softhand::fuzz
