// Numbers and texts in the bytes of a binary protocol.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>

namespace softhand {

/// Reads from the front. Behind the end everything is zero and empty, and the reader stays bad.
template <std::endian order>
class PacketReader {
 public:
  explicit PacketReader(std::string_view bytes) : bytes_(bytes) {}

  template <typename T>
  T read() {
    static_assert(std::is_arithmetic_v<T>);
    T value{};
    const std::string_view from = take(sizeof value);
    if (from.empty()) return value;
    std::array<char, sizeof value> copy;
    std::copy(from.begin(), from.end(), copy.begin());
    if constexpr (order != std::endian::native) std::reverse(copy.begin(), copy.end());
    std::memcpy(&value, copy.data(), sizeof value);
    return value;
  }
  /// A number of things, as an int32. A negative one is bad.
  std::size_t read_count() {
    const auto count = read<std::int32_t>();
    if (count < 0) good_ = false;
    return good_ ? static_cast<std::size_t>(count) : 0;
  }
  /// The next `count` pieces of `size` bytes each.
  std::string_view take(std::size_t size, std::size_t count = 1) {
    good_ = good_ && (size == 0 || count <= bytes_.size() / size);
    if (!good_) return {};
    const std::string_view out = bytes_.substr(0, size * count);
    bytes_.remove_prefix(out.size());
    return out;
  }
  /// A text, and the zero at its end, which the text does not have.
  std::string_view take_text() {
    const std::size_t end = bytes_.find('\0');
    good_ = good_ && end != std::string_view::npos;
    if (!good_) return {};
    const std::string_view out = bytes_.substr(0, end);
    bytes_.remove_prefix(end + 1);
    return out;
  }
  bool good() const { return good_; }
  /// Everything was read, and nothing behind the end.
  bool at_end() const { return good_ && bytes_.empty(); }

 private:
  std::string_view bytes_;
  bool good_ = true;
};

/// Appends numbers and texts.
template <std::endian order>
class PacketWriter {
 public:
  template <typename T>
  PacketWriter& add(T value) {
    static_assert(std::is_arithmetic_v<T>);
    std::array<char, sizeof value> copy;
    std::memcpy(copy.data(), &value, sizeof value);
    if constexpr (order != std::endian::native) std::reverse(copy.begin(), copy.end());
    bytes.append(copy.data(), copy.size());
    return *this;
  }
  /// `size` bytes: the text, then zeros.
  PacketWriter& add_padded(std::string_view text, std::size_t size) {
    bytes += text.substr(0, size);
    bytes.append(size - std::min(size, text.size()), '\0');
    return *this;
  }
  PacketWriter& add_text(std::string_view text) { return add_padded(text, text.size() + 1); }

  std::string bytes;
};

}  // namespace softhand
