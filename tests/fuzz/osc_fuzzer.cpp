// Packets of VMC performers, OSC trackers and plain hands (services/trackers/osc/README.md).
#include "fuzz/tracker_fuzzer.hpp"
#include "trackers/osc/performer.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const PerformerDecoder fresh(shipped_hand(), {.left_tracker = 1, .right_tracker = 2});
  PerformerDecoder decoder = fresh;
  CheckedSink sink;
  // Twice: the second time, all bones are known.
  for (int i = 0; i < 2; ++i) decoder.take({{reinterpret_cast<const char*>(data), size}, kArrival, 0, false}, sink);
  return 0;
}

}  // namespace softhand::fuzz
