// Messages of the bHaptics Player (services/tactile/bhaptics/README.md).
#include <algorithm>

#include "fuzz/fuzzer.hpp"
#include "tactile/bhaptics/player_messages.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text{reinterpret_cast<const char*>(data), size};
  for (const Side side : {Side::left, Side::right}) {
    const PlayerReport report = decode_player_report(text, side);
    expect(report.refusal == PlayerRefusal::none || !(report.has_motors || report.has_positions),
           "a refused message says nothing");
    expect(std::all_of(report.motors.begin(), report.motors.end(), [](int motor) { return motor <= 100; }),
           "an intensity is at most 100");
  }
  return 0;
}

}  // namespace softhand::fuzz
