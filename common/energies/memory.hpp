// What a term carries from one step to the next, as one value (docs/add-an-energy.md).
//
// A term with memory derives from `EnergyWithMemory<Term>` instead of `Energy` and has:
//
//   struct Memory {                      // plain values: no pointers, no Eigen types
//     std::vector<Item> items;           // of a trivially copyable type
//     double heat = 0;
//     void visit(auto& each) { each(items), each(heat); }  // names every member once
//   };
//   Memory save() const;                 // between two steps
//   void load(const Memory& memory);     // throws std::invalid_argument if `memory` does not fit the term
//   void reset();                        // forgets what the last steps left; values set by the caller stay
//
// A step must change the memory only in `end_step`. So a step that begins and does not end has no effect.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <type_traits>
#include <vector>

#include "energies/energy.hpp"
#include "messages/convert.hpp"

namespace softhand {

/// A pose without Eigen types, so that it is trivially copyable. The conversion keeps every bit.
struct PlainPose {
  Vec3 position{};
  Vec4 orientation{0, 0, 0, 1};
};
inline PlainPose to_plain(const Pose& pose) { return {to_wire(pose.position), to_wire(pose.orientation)}; }
struct PlainTwist {
  Vec3 linear{}, angular{};
};
inline PlainTwist to_plain(const Twist& twist) { return {to_wire(twist.linear), to_wire(twist.angular)}; }
inline Twist to_twist(const PlainTwist& twist) { return {to_vector(twist.linear), to_vector(twist.angular)}; }
inline Pose to_pose(const PlainPose& pose) { return to_pose(pose.position, pose.orientation); }

/// Appends plain values to bytes. Use the bytes in the same build only: they have no format number.
class MemoryWriter {
 public:
  explicit MemoryWriter(std::vector<std::byte>& out) : out_(out) {}
  template <typename T>
  void operator()(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>, "a memory has plain values only");
    append(&value, sizeof(T));
  }
  template <typename T>
  void operator()(const std::vector<T>& values) {
    static_assert(std::is_trivially_copyable_v<T>, "a memory has plain values only");
    (*this)(static_cast<std::uint64_t>(values.size()));
    append(values.data(), values.size() * sizeof(T));
  }

 private:
  void append(const void* data, std::size_t size) {
    const auto* bytes = static_cast<const std::byte*>(data);
    out_.insert(out_.end(), bytes, bytes + size);
  }
  std::vector<std::byte>& out_;
};

/// Reads the values in the order in which they were written. Throws std::invalid_argument if there are too few bytes.
class MemoryReader {
 public:
  explicit MemoryReader(std::span<const std::byte> bytes) : bytes_(bytes) {}
  template <typename T>
  void operator()(T& value) {
    static_assert(std::is_trivially_copyable_v<T>, "a memory has plain values only");
    take(&value, sizeof(T));
  }
  template <typename T>
  void operator()(std::vector<T>& values) {
    std::uint64_t count = 0;
    (*this)(count);
    if (count > bytes_.size() / sizeof(T)) throw std::invalid_argument("memory: fewer bytes than it states");
    values.resize(static_cast<std::size_t>(count));
    take(values.data(), values.size() * sizeof(T));
  }
  bool at_end() const { return bytes_.empty(); }

 private:
  void take(void* data, std::size_t size) {
    if (size > bytes_.size()) throw std::invalid_argument("memory: fewer bytes than expected");
    if (size > 0) std::memcpy(data, bytes_.data(), size);
    bytes_ = bytes_.subspan(size);
  }
  std::span<const std::byte> bytes_;
};

template <typename Memory>
void write_memory(Memory memory, MemoryWriter& out) {
  memory.visit(out);
}
template <typename Memory>
Memory read_memory(MemoryReader& in) {
  Memory memory;
  memory.visit(in);
  return memory;
}

/// The base of a term with memory. `Term` has Memory, save, load and reset.
template <typename Term>
class EnergyWithMemory : public Energy {
 public:
  void save_memory(MemoryWriter& out) const final { write_memory(static_cast<const Term&>(*this).save(), out); }
  void load_memory(MemoryReader& in) final { static_cast<Term&>(*this).load(read_memory<typename Term::Memory>(in)); }
  void reset_memory() final { static_cast<Term&>(*this).reset(); }
};

}  // namespace softhand
