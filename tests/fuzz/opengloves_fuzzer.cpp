// Lines of OpenGloves (services/haptics/opengloves/README.md).
#include "fuzz/tracker_fuzzer.hpp"
#include "haptics/opengloves/alpha_line.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const CurlLifter lifter(shipped_hand(), Side::right);
  AlphaDecoder decoder(Side::right, 4095);
  CheckedSink sink;
  Skeleton hand;
  for_each_line({reinterpret_cast<const char*>(data), size}, [&](const Arrival& line) {
    const auto* fingers = decoder.take(line);
    if (fingers == nullptr) return;
    for (const FingerCurl& finger : *fingers) {
      expect(std::abs(finger.splay) <= 1, "splay is between -1 and 1");
      for (const double curl : finger.curl)
        expect(!finger.valid || (curl >= 0 && curl <= 1), "curl is between 0 and 1");
    }
    lifter.lift(*fingers, hand);
    sink.hand(hand);
  });
  return 0;
}

}  // namespace softhand::fuzz
