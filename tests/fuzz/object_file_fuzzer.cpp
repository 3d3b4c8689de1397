// Object files (docs/object-file.md).
#include "fuzz/fuzzer.hpp"
#include "model/object_model.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  accepts([&] { parse_object(text, "fuzz.object.json"); });
  return 0;
}

}  // namespace softhand::fuzz
