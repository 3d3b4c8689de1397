// Messages and events of the Haply Inverse Service (services/haptics/haply/README.md).
#include <algorithm>
#include <cmath>

#include "fuzz/fuzzer.hpp"
#include "haptics/haply/haply_messages.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text{reinterpret_cast<const char*>(data), size};
  for (const std::string_view id : {"", "049D"}) {
    const HaplyReport report = decode_haply_report(text, id);
    expect(!report.has_device || report.refusal == HaplyRefusal::none, "a refused message has no device");
    if (!report.has_device) continue;
    for (const Vec3& vector : {report.position, report.velocity, report.force})
      expect(std::all_of(vector.begin(), vector.end(), [](double value) { return std::abs(value) <= 50; }),
             "vectors are finite");
    const std::string_view own(report.device_id.data());
    expect(!own.empty() && own.find_first_of("\"\\{}") == std::string_view::npos, "an id needs no escapes");
    expect(id.empty() || own == id, "the device is the wanted one");
    HaplyCommand(report.device_id, HaplyForceKey::values, Vector3(1, 2, 3));
  }
  const HaplyEvent event = decode_haply_event(text);
  expect(event.kind == HaplyEventKind::other || event.refusal == HaplyRefusal::none, "a refused event does nothing");
  return 0;
}

}  // namespace softhand::fuzz
