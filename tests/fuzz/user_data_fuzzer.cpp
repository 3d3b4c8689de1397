// What strangers say about themselves: the user data of participants and endpoints. The first byte is the length of the
// name beside it: the participant's, or the endpoint's type.
#include <algorithm>

#include "bus/user_data.hpp"
#include "fuzz/fuzzer.hpp"
#include "messages/convert.hpp"

namespace softhand::fuzz {
namespace {

// Logs and tables show these texts.
void expect_printable(std::string_view text) {
  expect(std::none_of(text.begin(), text.end(), [](unsigned char c) { return c < 32 || c == 127; }),
         "a text has no control characters");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view bytes(reinterpret_cast<const char*>(data) + 1, size - 1);
  const std::string name(bytes.substr(0, data[0]));
  const std::string_view user_data = bytes.substr(name.size());
  if (const auto peer = bus::detail::peer_of(name, user_data)) {
    for (const auto& text : {peer->name, peer->host, peer->rig}) {
      expect(text.back() == '\0', "a text ends");
      expect_printable(get_text(text));
    }
  }
  if (const auto endpoint = bus::detail::endpoint_of("topic", name, user_data)) {
    expect_printable(endpoint->type);
    expect_printable(endpoint->module);
    expect(bus::detail::endpoint_of("topic", endpoint->type, bus::detail::user_data_of(*endpoint)) == endpoint,
           "the user data of an accepted endpoint says the same");
  }
  return 0;
}

}  // namespace softhand::fuzz
