// Messages of programs that track landmarks (services/trackers/landmarks/README.md).
#include "fuzz/fuzzer.hpp"
#include "messages/convert.hpp"
#include "trackers/landmarks/landmarks.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  LandmarksMessage message;
  if (decode_landmarks({reinterpret_cast<const char*>(data), size}, message) != LandmarksRefusal::none) return 0;
  for (const Vec3& landmark : message.landmarks) expect(all_finite(landmark), "accepted landmarks are finite");
  LandmarksClock clock;
  clock.stamp(message, 1, 1'000'000'000);
  return 0;
}

}  // namespace softhand::fuzz
