// The newest value on its way from one thread to another.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace softhand {

/// Which of three slots belongs to the thread that stores, and which to the thread that loads. Neither waits or locks.
class LatestSlot {
 public:
  /// The slot that the storing thread may fill.
  std::size_t to_fill() const { return back_; }
  /// Offers the filled slot. Returns true if it replaced one that was not taken.
  bool offer() {
    const std::uint8_t before = middle_.exchange(back_ | kNew, std::memory_order_acq_rel);
    back_ = before & kIndex;
    return (before & kNew) != 0;
  }
  bool is_offered() const { return (middle_.load(std::memory_order_acquire) & kNew) != 0; }
  /// The newest slot that was offered. It belongs to the loading thread until the next call. Call it if `is_offered`.
  std::size_t take() {
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & kIndex;
    return front_;
  }

 private:
  static constexpr std::uint8_t kIndex = 3, kNew = 4;
  std::uint8_t back_ = 0;   // of the thread that stores
  std::uint8_t front_ = 2;  // of the thread that loads
  std::atomic<std::uint8_t> middle_{1};
};

/// One thread stores and one thread loads. Neither waits, locks or allocates. Older values are overwritten.
template <typename T>
class LatestValue {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  void store(const T& value) {
    slots_[slot_.to_fill()] = value;
    slot_.offer();
  }
  /// Returns false, and changes nothing, if no value was stored since the last call.
  bool load(T& out) {
    if (!slot_.is_offered()) return false;
    out = slots_[slot_.take()];
    return true;
  }

 private:
  std::array<T, 3> slots_{};
  LatestSlot slot_;
};

}  // namespace softhand
