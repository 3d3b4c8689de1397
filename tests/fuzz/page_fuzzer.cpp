// Requests of the viewer's page (docs/viewer.md).
#include <cmath>

#include "fuzz/fuzzer.hpp"
#include "viewer/frames.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  viewer::PageRequest request;
  if (viewer::decode({data, size}, request) != viewer::Refusal::none) return 0;
  if (const auto* show = std::get_if<viewer::ShowRequest>(&request))
    expect(std::isfinite(show->rate_hz), "an accepted rate is finite");
  return 0;
}

}  // namespace softhand::fuzz
