// Recordings of topics and flight files (MCAP).
#include "fuzz/fuzzer.hpp"
#include "runtime/record_file.hpp"

namespace softhand::fuzz {

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const ScratchFile file(data, size, ".mcap");
  accepts([&] {
    RecordReader reader(file.path());
    RecordedMessage message;
    std::size_t bytes = 0;
    while (reader.next(message)) {
      expect(reader.channels().contains(message.channel), "the channel of a message is known");
      expect((bytes += message.payload.size()) <= size, "messages are no longer than the file");
    }
  });
  return 0;
}

}  // namespace softhand::fuzz
