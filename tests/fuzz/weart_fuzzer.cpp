// Messages of the WEART middleware (services/tactile/weart/README.md), joined by their ends.
#include "fuzz/tracker_fuzzer.hpp"
#include "tactile/weart/weart_messages.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const CurlLifter lifter(shipped_hand(), Side::right);
  CheckedSink sink;
  Skeleton hand;
  for_each_packet({reinterpret_cast<const char*>(data), size}, kWeartEnd, [&](const Arrival& packet) {
    const WeartReport report = decode_weart(packet.bytes, Side::right);
    expect(report.refusal == WeartRefusal::none || report.kind == WeartKind::other, "a refused message says nothing");
    expect(report.value >= 0, "a value is not negative");
    if (report.kind != WeartKind::tracking) return;
    for (const FingerCurl& finger : report.fingers) {
      expect(std::abs(finger.splay) <= 1, "splay is between -1 and 1");
      for (const double curl : finger.curl) expect(curl >= 0 && curl <= 1, "curl is between 0 and 1");
    }
    lifter.lift(report.fingers, hand);
    sink.hand(hand);
  });
  return 0;
}

}  // namespace softhand::fuzz
