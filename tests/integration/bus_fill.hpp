// Fills a message with seeded, finite values that differ from field to field.
#pragma once

#include <random>
#include <vector>

#include "bus/cdr.hpp"

namespace softhand::bus {

struct Fill {
  std::mt19937_64& random;
  bool to_capacity = false;

  template <typename T>
  void operator()(T& value) {
    if constexpr (std::is_floating_point_v<T>) {
      value = static_cast<T>(std::uniform_real_distribution<double>(-10, 10)(random));
    } else if constexpr (std::is_arithmetic_v<T>) {
      value = static_cast<T>(random());
    } else if constexpr (detail::is_text<T>) {
      value.fill(0);
      const std::size_t length = to_capacity ? value.size() - 1 : random() % value.size();
      for (std::size_t i = 0; i < length; ++i) value[i] = static_cast<char>('a' + random() % 26);
    } else if constexpr (detail::is_array<T>) {
      for (auto& item : value) (*this)(item);
    } else if constexpr (detail::is_sequence<T>) {
      value.count = static_cast<std::uint32_t>(to_capacity ? value.max_size() : 1 + random() % value.max_size());
      for (auto& item : value) (*this)(item);
    } else {
      visit_fields(*this, value);
    }
  }
  void key(const char*, auto& value) { (*this)(value); }
  void field(const char*, auto& value) { (*this)(value); }
};

template <typename T>
std::unique_ptr<T> filled(std::uint64_t seed, bool to_capacity = false) {
  std::mt19937_64 random(seed);
  auto message = std::make_unique<T>();
  Fill fill{random, to_capacity};
  fill(*message);
  return message;
}

template <typename T>
std::vector<std::byte> bytes_of(const T& message) {
  std::vector<std::byte> bytes(encoded_size(message));
  bytes.resize(encode(message, bytes));
  return bytes;
}

}  // namespace softhand::bus
