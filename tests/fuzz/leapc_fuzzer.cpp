// Events of the library LeapC (services/trackers/leap/README.md).
#include <cstring>
#include <vector>

#include "fuzz/tracker_fuzzer.hpp"
#include "trackers/leap/leap_hands.hpp"
#include "trackers/leap/leapc_service.hpp"

namespace softhand::fuzz {

// An event, and then its hands. The library is trusted with the number of hands that are there: it is never more.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  leapc::TrackingEvent event{};
  if (size < sizeof event) return 0;
  std::memcpy(&event, data, sizeof event);
  data += sizeof event, size -= sizeof event;
  std::vector<leapc::Hand> hands(size / sizeof(leapc::Hand));
  if (!hands.empty()) std::memcpy(hands.data(), data, hands.size() * sizeof(leapc::Hand));
  event.hands = hands.empty() ? nullptr : hands.data();
  if (event.hand_count <= 100) event.hand_count = std::min<std::uint32_t>(event.hand_count, hands.size());
  static const LeapDecoder fresh(shipped_hand(), false);
  LeapDecoder decoder = fresh;
  CheckedSink sink;
  decoder.take({read_leapc(event, kArrival).bytes(), kArrival, 1, true}, sink);
  return 0;
}

}  // namespace softhand::fuzz
