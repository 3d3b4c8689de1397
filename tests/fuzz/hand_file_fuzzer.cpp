// Hand files (docs/hand-file.md).
#include "fuzz/fuzzer.hpp"
#include "model/hand_model.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  accepts([&] {
    const HandModel hand = parse_hand(text, "fuzz.hand.json");
    expect(lumped_masses(hand).size() == hand.nodes.size(), "an accepted hand has masses");
  });
  return 0;
}

}  // namespace softhand::fuzz
