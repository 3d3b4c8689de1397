// Recorded hands (CSV).
#include <sstream>

#include "fuzz/fuzzer.hpp"
#include "trackers/replay/recording.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::istringstream in(std::string(reinterpret_cast<const char*>(data), size));
  accepts([&] {
    const Recording recording = Recording::parse(in, "fuzz.csv");
    for (const double time : {-1.0, 0.0, 0.5 * recording.duration(), recording.duration() + 1}) {
      for (const Pose& joint : recording.at(time))
        expect(joint.position.allFinite() && joint.orientation.coeffs().allFinite(), "its joints are finite");
    }
  });
  return 0;
}

}  // namespace softhand::fuzz
