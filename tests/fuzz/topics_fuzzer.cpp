// Samples of DDS topics. The first byte chooses the topic. The rest is the sample's encoding.
#include <memory>
#include <vector>

#include "bus/cdr.hpp"
#include "bus/topics.hpp"
#include "fuzz/fuzzer.hpp"

namespace softhand::fuzz {
namespace {

// Accepted bytes give a message whose own encoding is accepted, too, and has the same bytes again.
template <typename T>
void read(std::span<const std::byte> bytes) {
  static const auto message = std::make_unique<T>(), again = std::make_unique<T>();
  if (!bus::decode(bytes, *message)) return;
  std::vector<std::byte> first(bus::encoded_size(*message)), second(first.size());
  expect(bus::encode(*message, first) == first.size(), "an accepted message can be encoded");
  expect(bus::decode<T>(first, *again), "its encoding is accepted");
  expect(bus::encode(*again, second) == second.size() && first == second, "encoding it again gives the same bytes");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::span bytes(reinterpret_cast<const std::byte*>(data) + 1, size - 1);
  int topic = 0;
  bus::topics::for_each([&]<typename T>(const bus::Topic<T>&) {
    if (topic++ == data[0]) read<T>(bytes);
  });
  return 0;
}

}  // namespace softhand::fuzz
