// Plain values as bytes: written, read, hashed, and compared field by field. A plain value is a number, an enumeration,
// a text, an Eigen matrix or quaternion, an array, a vector or an aggregate of plain values. A class can have a member
// function `visit_members(self, visit)` instead. Nothing is written between the numbers, so padding has no effect.
// Writing, hashing and comparing do not allocate. Pointers are refused when the code is compiled.
//
// The bytes are for the same build on the same kind of machine. They carry no names and no version.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#include "messages/members.hpp"
#include "messages/messages.hpp"

namespace softhand {
namespace plain_detail {

template <typename T>
concept Number = std::is_arithmetic_v<T> || std::is_enum_v<T>;
template <typename T>
concept Matrix = std::is_base_of_v<Eigen::PlainObjectBase<T>, T>;
template <typename T>
inline constexpr bool is_array = false;
template <typename T, std::size_t n>
inline constexpr bool is_array<std::array<T, n>> = true;
template <typename T>
inline constexpr bool is_vector = false;
template <typename T>
inline constexpr bool is_vector<std::vector<T>> = true;
template <typename T>
inline constexpr bool is_bounded = false;
template <typename T, std::size_t n>
inline constexpr bool is_bounded<BoundedVector<T, n>> = true;
template <typename T>
concept Visited = requires(T& value) {
  T::visit_members(value, [](auto&) {});
};

}  // namespace plain_detail

/// Visits `value` and all that is in it. A visitor has `bytes(pointer, size)` for numbers, and `enter(i)` and `leave()`
/// around each part. `count(n)` gets the number of elements of a vector and returns the number to use. A visitor that
/// changes values has `require(size)`, too: it throws unless so many bytes follow. So a wrong count allocates no more
/// memory than the bytes can fill.
template <typename Visitor, typename T>
void visit_plain(Visitor& visitor, T& value) {
  using namespace plain_detail;
  using Plain = std::remove_const_t<T>;
  static_assert(!std::is_pointer_v<Plain>, "a pointer is not a plain value");
  const auto visit_items = [&visitor](auto* items, std::size_t size) {
    if constexpr (Number<std::remove_cvref_t<decltype(*items)>>) {
      if (size > 0) visitor.bytes(items, size * sizeof(*items));
    } else {
      for (std::size_t i = 0; i < size; ++i) {
        visitor.enter(i);
        visit_plain(visitor, items[i]);
        visitor.leave();
      }
    }
  };
  if constexpr (Number<Plain>) {
    visitor.bytes(&value, sizeof(value));
  } else if constexpr (Matrix<Plain>) {
    if constexpr (Plain::SizeAtCompileTime == Eigen::Dynamic) {
      const auto rows = static_cast<Eigen::Index>(visitor.count(static_cast<std::size_t>(value.rows())));
      const auto columns = static_cast<Eigen::Index>(visitor.count(static_cast<std::size_t>(value.cols())));
      if constexpr (!std::is_const_v<T>) {
        // Eigen does not check the shape, and would use memory that it has not allocated.
        if ((Plain::RowsAtCompileTime != Eigen::Dynamic && rows != Plain::RowsAtCompileTime) ||
            (Plain::ColsAtCompileTime != Eigen::Dynamic && columns != Plain::ColsAtCompileTime))
          throw std::runtime_error("a matrix in the record has another shape");
        visitor.require(static_cast<std::size_t>(rows * columns) * sizeof(typename Plain::Scalar));
        if (rows != value.rows() || columns != value.cols()) value.resize(rows, columns);
      }
    }
    visit_items(value.data(), static_cast<std::size_t>(value.size()));
  } else if constexpr (std::is_same_v<Plain, Eigen::Quaterniond>) {
    visit_items(value.coeffs().data(), 4);
  } else if constexpr (is_array<Plain>) {
    visit_items(value.data(), value.size());
  } else if constexpr (is_vector<Plain> || std::is_same_v<Plain, std::string>) {
    const std::size_t size = visitor.count(value.size());
    if constexpr (std::is_const_v<T>) {
      visit_items(value.data(), size);
    } else if constexpr (Number<typename Plain::value_type>) {
      visitor.require(size * sizeof(typename Plain::value_type));
      value.resize(size);
      visit_items(value.data(), size);
    } else {
      value.resize(std::min(size, value.size()));
      for (std::size_t i = 0; i < size; ++i) {
        if (i == value.size()) value.emplace_back();
        visitor.enter(i);
        visit_plain(visitor, value[i]);
        visitor.leave();
      }
    }
  } else if constexpr (is_bounded<Plain>) {
    const std::size_t size = visitor.count(value.size());
    if constexpr (!std::is_const_v<T>) {
      if (size > value.max_size()) throw std::runtime_error("a list in the record is too long");
      value.count = static_cast<std::uint32_t>(size);
    }
    visit_items(value.items.data(), size);
  } else {
    std::size_t place = 0;
    const auto visit = [&](auto& member) {
      visitor.enter(place++);
      visit_plain(visitor, member);
      visitor.leave();
    };
    if constexpr (Visited<Plain>) {
      Plain::visit_members(value, visit);
    } else {
      for_each_member(value, visit);
    }
  }
}

/// Writes into memory of fixed size. After an overflow, `overflowed` is true and the rest is not written.
class ByteWriter {
 public:
  explicit ByteWriter(std::span<std::byte> memory) : memory_(memory) {}
  template <typename T>
  void write(const T& value) {
    visit_plain(*this, value);
  }
  std::size_t size() const { return size_; }
  bool overflowed() const { return overflowed_; }
  std::span<const std::byte> written() const { return memory_.first(size_); }

  void bytes(const void* from, std::size_t size) {
    if (overflowed_ || size > memory_.size() - size_) {
      overflowed_ = true;
      return;
    }
    std::memcpy(memory_.data() + size_, from, size);
    size_ += size;
  }
  std::size_t count(std::size_t n) {
    const auto value = static_cast<std::uint32_t>(n);
    bytes(&value, sizeof(value));
    return n;
  }
  void enter(std::size_t) {}
  void leave() {}

 private:
  std::span<std::byte> memory_;
  std::size_t size_ = 0;
  bool overflowed_ = false;
};

/// Throws std::runtime_error at the end of the bytes.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::byte> rest) : rest_(rest) {}
  template <typename T>
  void read(T& value) {
    visit_plain(*this, value);
  }
  template <typename T>
  T take() {
    T value{};
    read(value);
    return value;
  }
  std::span<const std::byte> rest() const { return rest_; }

  void require(std::size_t size) const {
    if (size > rest_.size()) throw std::runtime_error("the record is too short");
  }
  template <typename T>
  void bytes(T* to, std::size_t size) {
    require(size);
    const std::span<const std::byte> from = rest_.first(size);
    // Any other byte in a bool is undefined behaviour.
    if (std::is_same_v<T, bool> && std::ranges::any_of(from, [](std::byte each) { return each > std::byte{1}; }))
      throw std::runtime_error("a truth value in the record is neither 0 nor 1");
    std::memcpy(to, from.data(), size);
    rest_ = rest_.subspan(size);
  }
  std::size_t count(std::size_t) {
    std::uint32_t value = 0;
    bytes(&value, sizeof(value));
    if (value > kMostItems) throw std::runtime_error("a list in the record is too long");
    return value;
  }
  void enter(std::size_t) {}
  void leave() {}

 private:
  static constexpr std::uint32_t kMostItems = 10'000'000;
  std::span<const std::byte> rest_;
};

/// A 64-bit hash of the numbers of a value. Not for protection against forgery.
class PlainHash {
 public:
  template <typename T>
  PlainHash& add(const T& value) {
    visit_plain(*this, value);
    return *this;
  }
  std::uint64_t value() const { return hash_ ^ (hash_ >> 32); }

  void bytes(const void* from, std::size_t size) {
    const auto* next = static_cast<const std::byte*>(from);
    for (; size >= 8; size -= 8, next += 8) {
      std::uint64_t word = 0;
      std::memcpy(&word, next, 8);
      mix(word);
    }
    if (size == 0) return;
    std::uint64_t word = 0;
    std::memcpy(&word, next, size);
    mix(word);
  }
  std::size_t count(std::size_t n) {
    mix(n);
    return n;
  }
  void enter(std::size_t) {}
  void leave() {}

 private:
  void mix(std::uint64_t word) {
    hash_ = (hash_ ^ word) * 0x9e3779b97f4a7c15ULL;
    hash_ ^= hash_ >> 29;
  }
  std::uint64_t hash_ = 0x243f6a8885a308d3ULL;
};

template <typename T>
std::uint64_t plain_hash(const T& value) {
  return PlainHash().add(value).value();
}

/// Compares values with their recorded bytes, one after another.
class PlainComparison {
 public:
  explicit PlainComparison(std::span<const std::byte> recorded) : rest_(recorded) {}
  /// `name` begins the path of a difference.
  template <typename T>
  void compare(const char* name, const T& value) {
    if (differs_) return;
    name_ = name;
    depth_ = 0;
    visit_plain(*this, value);
  }
  bool differs() const { return differs_; }
  /// Path of the first difference: a name, and the index of the member or element on each level. "objects.3.0".
  const std::string& where() const { return where_; }

  void bytes(const void* from, std::size_t size) {
    if (differs_) return;
    if (size <= rest_.size() && std::memcmp(from, rest_.data(), size) == 0) {
      rest_ = rest_.subspan(size);
      return;
    }
    std::size_t same = 0;
    while (same < size && same < rest_.size() && static_cast<const std::byte*>(from)[same] == rest_[same]) ++same;
    note();
    where_ += " (byte " + std::to_string(same) + " of " + std::to_string(size) + ")";
  }
  std::size_t count(std::size_t n) {
    const auto value = static_cast<std::uint32_t>(n);
    if (differs_) return n;
    if (rest_.size() >= sizeof(value) && std::memcmp(&value, rest_.data(), sizeof(value)) == 0) {
      rest_ = rest_.subspan(sizeof(value));
    } else {
      note();
      where_ += " (length)";
    }
    return n;
  }
  void enter(std::size_t i) { path_[depth_++ % path_.size()] = i; }
  void leave() { --depth_; }

 private:
  void note() {
    differs_ = true;
    where_ = name_;
    for (std::size_t i = 0; i < depth_ && i < path_.size(); ++i) where_ += "." + std::to_string(path_[i]);
  }

  std::span<const std::byte> rest_;
  const char* name_ = "";
  std::array<std::size_t, 16> path_{};
  std::size_t depth_ = 0;
  bool differs_ = false;
  std::string where_;
};

}  // namespace softhand
