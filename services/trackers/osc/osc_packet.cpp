#include "trackers/osc/osc_packet.hpp"

#include <bit>

namespace softhand {
namespace {

using namespace std::string_view_literals;
constexpr int kDeepest = 4;

bool take_word(std::string_view& bytes, std::uint32_t& out) {
  if (bytes.size() < 4) return false;
  out = 0;
  for (int i = 0; i < 4; ++i) out = out << 8 | static_cast<unsigned char>(bytes[static_cast<std::size_t>(i)]);
  bytes.remove_prefix(4);
  return true;
}

// Text up to its NUL, and the padding to a multiple of four bytes.
bool take_text(std::string_view& bytes, std::string_view& out) {
  const std::size_t end = bytes.find('\0');
  if (end == std::string_view::npos) return false;
  const std::size_t size = end / 4 * 4 + 4;
  if (size > bytes.size()) return false;
  out = bytes.substr(0, end);
  bytes.remove_prefix(size);
  return true;
}

bool skip(std::string_view& bytes, std::size_t size) {
  if (size > bytes.size()) return false;
  bytes.remove_prefix(size);
  return true;
}

bool read_message(std::string_view bytes, OscMessage& out) {
  std::string_view types;
  if (!take_text(bytes, out.address) || !out.address.starts_with('/') || !take_text(bytes, types) ||
      !types.starts_with(','))
    return false;
  bool has_text = false;
  for (const char type : types.substr(1)) {
    std::uint32_t word = 0;
    std::string_view text;
    switch (type) {
      case 'f':
        if (!take_word(bytes, word)) return false;
        if (out.count < out.numbers.size()) out.numbers[out.count++] = std::bit_cast<float>(word);
        break;
      case 's':
        if (!take_text(bytes, text)) return false;
        if (!has_text) out.text = text;
        has_text = true;
        break;
      case 'i':
        if (!skip(bytes, 4)) return false;
        break;
      case 'h':
      case 'd':
      case 't':
        if (!skip(bytes, 8)) return false;
        break;
      case 'b':
        if (!take_word(bytes, word) || word > bytes.size() || !skip(bytes, (word + 3) / 4 * 4)) return false;
        break;
      case 'T':
      case 'F':
      case 'N':
      case 'I':
        break;
      default:
        return false;
    }
  }
  return bytes.empty();
}

// `take` is null while the packet is only checked.
bool read(std::string_view bytes, int depth, const std::function<void(const OscMessage&)>* take) {
  constexpr std::string_view kBundle = "#bundle\0"sv;
  if (!bytes.starts_with(kBundle)) {
    OscMessage message;
    if (!read_message(bytes, message)) return false;
    if (take != nullptr) (*take)(message);
    return true;
  }
  if (depth == kDeepest || !skip(bytes, kBundle.size() + 8)) return false;  // after the time tag
  while (!bytes.empty()) {
    std::uint32_t size = 0;
    if (!take_word(bytes, size) || size > bytes.size()) return false;
    if (!read(bytes.substr(0, size), depth + 1, take)) return false;
    bytes.remove_prefix(size);
  }
  return true;
}

}  // namespace

bool read_osc(std::string_view packet, const std::function<void(const OscMessage&)>& take) {
  return read(packet, 0, nullptr) && read(packet, 0, &take);
}

}  // namespace softhand
