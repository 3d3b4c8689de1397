// Frames of a headset's page (services/trackers/webxr/README.md).
#include "fuzz/fuzzer.hpp"
#include "trackers/webxr/webxr_frames.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  WebXrSample sample;
  if (decode_webxr({reinterpret_cast<const char*>(data), size}, sample) != WebXrRefusal::none) return 0;
  WebXrClock clock;
  constexpr Nanoseconds arrival = 1'000'000'000;
  if (clock.stamp(sample, 1, arrival) == WebXrRefusal::none)
    expect(sample.head.stamp.sample_time <= arrival, "no stamp is later than the arrival");
  return 0;
}

}  // namespace softhand::fuzz
