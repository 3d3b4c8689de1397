// What an OpenXR runtime locates (services/trackers/openxr/README.md).
#include <cstring>

#include "fuzz/tracker_fuzzer.hpp"
#include "trackers/openxr/openxr_hands.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  OpenXrFrame frame;
  const auto read = [&](auto& to) {
    const std::size_t count = std::min(size, sizeof to);
    std::memcpy(&to, data, count);
    data += count, size -= count;
  };
  // Member by member, because not all bytes are a bool.
  read(frame.time);
  read(frame.head);
  for (OpenXrHand& hand : frame.hands) {
    std::uint8_t bits = 0;
    read(bits);
    hand.is_active = (bits & 1) != 0;
    hand.is_from_controller = (bits & 2) != 0;
    read(hand.joints);
    read(hand.velocities);
  }
  OpenXrDecoder decoder;
  CheckedSink sink;
  decoder.take({frame.bytes(), kArrival, 1, true}, sink);
  return 0;
}

}  // namespace softhand::fuzz
