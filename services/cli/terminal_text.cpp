#include "cli/terminal_text.hpp"

namespace softhand {

std::string terminal_text(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto byte = static_cast<unsigned char>(text[i]);
    const auto next = i + 1 < text.size() ? static_cast<unsigned char>(text[i + 1]) : 0;
    // UTF-8 has U+0080 to U+009F in two bytes.
    const bool is_wide_control = byte == 0xc2 && next >= 0x80 && next <= 0x9f;
    const bool is_control = (byte < 0x20 && byte != '\n') || byte == 0x7f;
    out += is_control || is_wide_control ? '?' : text[i];
    i += is_wide_control;
  }
  return out;
}

}  // namespace softhand
