// Conversion between messages and bytes. The encoding is XCDR1, little endian, with a four-byte header: both DDS
// vendors send this for @final types. The code reads and writes the plain struct directly, without intermediate objects
// or allocation. The same bytes may be logged (MCAP encoding `cdr`) and decoded later.
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <string>
#include <type_traits>

#include "bus/fields.hpp"

namespace softhand::bus {

static_assert(std::endian::native == std::endian::little, "the wire format is written by copying little-endian memory");

namespace detail {

template <typename T>
concept Number = std::is_arithmetic_v<T>;
template <typename T>
inline constexpr bool is_text = false;
template <std::size_t n>
inline constexpr bool is_text<std::array<char, n>> = true;
template <typename T>
inline constexpr bool is_array = false;
template <typename T, std::size_t n>
inline constexpr bool is_array<std::array<T, n>> = !std::is_same_v<T, char>;
template <typename T>
inline constexpr bool is_sequence = false;
template <typename T, std::size_t n>
inline constexpr bool is_sequence<BoundedVector<T, n>> = true;

/// Number type of the elements of a nested std::array; void if the elements are structs.
template <typename T>
struct Leaf {
  using Type = std::conditional_t<std::is_arithmetic_v<T>, T, void>;
};
template <typename T, std::size_t n>
struct Leaf<std::array<T, n>> : Leaf<T> {};
template <typename T>
using LeafOf = typename Leaf<T>::Type;

inline constexpr std::size_t kHeaderSize = 4;
constexpr std::size_t padding(std::size_t offset, std::size_t alignment) {
  return (alignment - offset % alignment) % alignment;
}

/// Measures the size in bytes without the header: of the given message, or the largest possible size (at_capacity).
template <bool at_capacity>
struct Measure {
  std::size_t offset = 0;

  void number(std::size_t size, std::size_t count) { offset += padding(offset, size) + size * count; }

  template <typename T>
  void operator()(const T& value) {
    if constexpr (Number<T>) {
      number(sizeof(T), 1);
    } else if constexpr (is_text<T>) {
      number(4, 1);
      offset += at_capacity ? value.size() : strnlen(value.data(), value.size() - 1) + 1;
    } else if constexpr (is_array<T>) {
      items(value.data(), value.size());
    } else if constexpr (is_sequence<T>) {
      number(4, 1);
      // A count beyond the capacity has no elements to measure. Encoding refuses it.
      items(value.items.data(), at_capacity ? value.max_size() : std::min(value.size(), value.max_size()));
    } else {
      visit_fields(*this, value);
    }
  }
  template <typename T>
  void items(const T* first, std::size_t count) {
    if constexpr (!std::is_void_v<LeafOf<T>>) {
      if (count > 0) number(sizeof(LeafOf<T>), count * sizeof(T) / sizeof(LeafOf<T>));
    } else {
      for (std::size_t i = 0; i < count; ++i) (*this)(first[i]);
    }
  }
  void key(const char*, const auto& value) { (*this)(value); }
  void field(const char*, const auto& value) { (*this)(value); }
};

struct Encode {
  std::span<std::byte> out;  ///< the bytes after the header
  std::size_t offset = 0;
  bool ok = true;

  void copy(const void* from, std::size_t size, std::size_t alignment) {
    const std::size_t pad = padding(offset, alignment);
    if (!ok || out.size() - offset < pad + size) {
      ok = false;
      return;
    }
    if (pad > 0) std::memset(out.data() + offset, 0, pad);
    if (size > 0) std::memcpy(out.data() + offset + pad, from, size);
    offset += pad + size;
  }

  template <typename T>
  void operator()(const T& value) {
    if constexpr (Number<T>) {
      copy(&value, sizeof(T), sizeof(T));
    } else if constexpr (is_text<T>) {
      const auto length = static_cast<std::uint32_t>(strnlen(value.data(), value.size() - 1));
      const std::uint32_t size = length + 1;
      const char zero = 0;
      copy(&size, 4, 4);
      copy(value.data(), length, 1);
      copy(&zero, 1, 1);
    } else if constexpr (is_array<T>) {
      items(value.data(), value.size());
    } else if constexpr (is_sequence<T>) {
      if (value.count > value.max_size()) {
        ok = false;
        return;
      }
      copy(&value.count, 4, 4);
      items(value.items.data(), value.size());
    } else {
      visit_fields(*this, value);
    }
  }
  template <typename T>
  void items(const T* first, std::size_t count) {
    if constexpr (!std::is_void_v<LeafOf<T>>) {
      if (count > 0) copy(first, count * sizeof(T), sizeof(LeafOf<T>));
    } else {
      for (std::size_t i = 0; i < count; ++i) (*this)(first[i]);
    }
  }
  void key(const char*, const auto& value) { (*this)(value); }
  void field(const char*, const auto& value) { (*this)(value); }
};

/// Never reads outside `in`, even if the bytes are invalid. Sets the elements beyond a sequence's count and the bytes
/// after the end of a text to zero.
struct Decode {
  std::span<const std::byte> in;  ///< the bytes after the header
  std::size_t offset = 0;
  bool ok = true;

  bool copy(void* to, std::size_t size, std::size_t alignment) {
    const std::size_t pad = padding(offset, alignment);
    if (!ok || in.size() - offset < pad || in.size() - offset - pad < size) return ok = false;
    if (size > 0) std::memcpy(to, in.data() + offset + pad, size);
    offset += pad + size;
    return true;
  }

  template <typename T>
  void operator()(T& value) {
    if constexpr (Number<T>) {
      copy(&value, sizeof(T), sizeof(T));
    } else if constexpr (is_text<T>) {
      std::uint32_t size = 0;  // includes the terminating zero; some writers send 0 for an empty text
      if (!copy(&size, 4, 4)) return;
      value.fill(0);
      if (size > value.size()) {
        ok = false;
      } else if (copy(value.data(), size, 1) && size > 0 && value[size - 1] != 0) {
        ok = false;
      }
    } else if constexpr (is_array<T>) {
      items(value.data(), value.size());
    } else if constexpr (is_sequence<T>) {
      std::uint32_t count = 0;
      if (!copy(&count, 4, 4)) return;
      if (count > value.max_size()) {
        ok = false;
        return;
      }
      for (std::size_t i = count; i < value.count; ++i) value.items[i] = {};
      value.count = count;
      items(value.items.data(), count);
    } else {
      visit_fields(*this, value);
    }
  }
  template <typename T>
  void items(T* first, std::size_t count) {
    if constexpr (!std::is_void_v<LeafOf<T>>) {
      if (count > 0) copy(first, count * sizeof(T), sizeof(LeafOf<T>));
    } else {
      for (std::size_t i = 0; i < count && ok; ++i) (*this)(first[i]);
    }
  }
  void key(const char*, auto& value) { (*this)(value); }
  void field(const char*, auto& value) { (*this)(value); }
};

/// Big-endian CDR of the key fields. DDS computes the key hash from it (DDSI-RTPS 9.6.3.8). Keys contain only uint32
/// and texts.
struct EncodeKey {
  std::array<std::byte, 80> bytes{};
  std::size_t size = 0;

  void operator()(std::uint32_t value) {
    size += padding(size, 4);
    for (int shift = 24; shift >= 0; shift -= 8) bytes[size++] = static_cast<std::byte>(value >> shift);
  }
  template <std::size_t n>
  void operator()(const std::array<char, n>& text) {
    static_assert(n + 4 <= 80);
    const std::size_t length = strnlen(text.data(), n - 1);
    (*this)(static_cast<std::uint32_t>(length + 1));
    std::memcpy(bytes.data() + size, text.data(), length);
    size += length;
    bytes[size++] = std::byte{0};
  }
  void operator()(const HandKey& hand) { visit_fields(*this, hand); }
  void key(const char*, const auto& value) { (*this)(value); }
  void field(const char*, const auto&) {}
};

/// Size of the key at full text length; 0 if the type has no key.
struct MeasureKey {
  Measure<true> measure;
  void key(const char*, const auto& value) { measure(value); }
  void field(const char*, const auto&) {}
};

/// Writes the definition of a type as text: names, kinds, sizes and bounds of all fields.
struct Define {
  std::string text;

  template <typename T>
  void operator()(const T& value) {
    if constexpr (Number<T>) {
      text += (std::is_floating_point_v<T> ? "float"
               : std::is_signed_v<T>       ? "int"
                                           : "uint") +
              std::to_string(8 * sizeof(T));
    } else if constexpr (is_text<T>) {
      text += "string<" + std::to_string(value.size() - 1) + ">";
    } else if constexpr (is_array<T>) {
      (*this)(value[0]);
      text += "[" + std::to_string(value.size()) + "]";
    } else if constexpr (is_sequence<T>) {
      (*this)(value.items[0]);
      text += "<" + std::to_string(value.max_size()) + ">";
    } else {
      text += "{";
      visit_fields(*this, value);
      text += "}";
    }
  }
  void key(const char* name, const auto& value) {
    text += "@";
    field(name, value);
  }
  void field(const char* name, const auto& value) {
    text += std::string(name) + ":";
    (*this)(value);
    text += ";";
  }
};

/// Target of a reader's `take`. The flag is false if the bytes were not a valid T.
template <typename T>
struct Received {
  T value{};
  bool well_formed = false;
};

}  // namespace detail

/// Hash of the definition of T: 64-bit FNV-1a of its text. Two programs with different hashes do not understand each
/// other's samples.
template <typename T>
std::uint64_t definition_hash() {
  static const std::uint64_t hash = [] {
    detail::Define define;
    define(*std::make_unique<T>());
    std::uint64_t sum = 14695981039346656037u;
    for (const char c : define.text) sum = (sum ^ static_cast<unsigned char>(c)) * 1099511628211u;
    return sum;
  }();
  return hash;
}

/// Size of `message` on the wire in bytes, header included.
template <typename T>
std::size_t encoded_size(const T& message) {
  detail::Measure<false> measure;
  measure(message);
  return detail::kHeaderSize + measure.offset;
}

/// Largest size of any T on the wire in bytes, header included.
template <typename T>
std::size_t max_encoded_size() {
  static const std::size_t size = [] {
    detail::Measure<true> measure;
    measure(*std::make_unique<T>());
    return detail::kHeaderSize + measure.offset;
  }();
  return size;
}

/// Writes `message` to `out` and returns the number of bytes. Returns 0 if the message does not fit, or if the count of
/// a sequence exceeds its capacity.
template <typename T>
std::size_t encode(const T& message, std::span<std::byte> out) {
  constexpr std::array<std::uint8_t, 4> header{0, 1, 0, 0};  // CDR, little endian
  if (out.size() < detail::kHeaderSize) return 0;
  std::memcpy(out.data(), header.data(), header.size());
  detail::Encode encoder{out.subspan(detail::kHeaderSize)};
  encoder(message);
  return encoder.ok ? detail::kHeaderSize + encoder.offset : 0;
}

/// Reads `bytes` into `message`. Returns false unless the bytes are exactly one T. Reasons: other encoding or byte
/// order, truncated, longer than padding explains, a sequence or text beyond its bound. `message` is then unspecified.
/// Values are not checked: NaN is accepted.
template <typename T>
bool decode(std::span<const std::byte> bytes, T& message) {
  if (bytes.size() < detail::kHeaderSize || bytes[0] != std::byte{0} || bytes[1] != std::byte{1}) return false;
  detail::Decode decoder{bytes.subspan(detail::kHeaderSize)};
  decoder(message);
  return decoder.ok && decoder.in.size() - decoder.offset < 4;
}

/// A message type as a table of functions. The DDS layer sees nothing else of the type.
struct TypeCodec {
  const char* name;  ///< DDS type name
  std::uint64_t (*hash)();
  std::size_t (*max_size)();
  std::size_t (*size)(const void* message);
  std::size_t (*encode)(const void* message, std::span<std::byte> out);
  void* (*create_received)();
  void (*destroy_received)(void* received);
  void (*decode)(std::span<const std::byte> bytes, void* received);
  bool (*is_well_formed)(const void* received);
  Stamp& (*stamp)(void* received);
  std::size_t (*max_key_size)();
  /// Writes the big-endian key. `message` points to a T, or to a Received<T>, which has the T as its first member.
  std::size_t (*key)(const void* message, std::span<std::byte, 80> out);
};

template <typename T>
inline const TypeCodec& codec_of(const char* type_name) {
  static const TypeCodec codec{
      type_name,
      [] { return definition_hash<T>(); },
      [] { return max_encoded_size<T>(); },
      [](const void* message) { return encoded_size(*static_cast<const T*>(message)); },
      [](const void* message, std::span<std::byte> out) { return bus::encode(*static_cast<const T*>(message), out); },
      []() -> void* { return new detail::Received<T>; },
      [](void* received) { delete static_cast<detail::Received<T>*>(received); },
      [](std::span<const std::byte> bytes, void* received) {
        auto& sample = *static_cast<detail::Received<T>*>(received);
        sample.well_formed = bus::decode(bytes, sample.value);
        // A refused message must not leave a count or elements in the struct for the next message.
        if (!sample.well_formed) sample.value = T{};
      },
      [](const void* received) { return static_cast<const detail::Received<T>*>(received)->well_formed; },
      [](void* received) -> Stamp& { return static_cast<detail::Received<T>*>(received)->value.stamp; },
      [] {
        detail::MeasureKey measure;
        visit_fields(measure, *std::make_unique<T>());
        return measure.measure.offset;
      },
      [](const void* message, std::span<std::byte, 80> out) {
        detail::EncodeKey key;
        visit_fields(key, *static_cast<const T*>(message));
        std::memcpy(out.data(), key.bytes.data(), key.size);
        return key.size;
      }};
  return codec;
}

}  // namespace softhand::bus
