// The newest value on its way from one thread to another.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <type_traits>

namespace softhand {

/// One thread stores and one thread loads. Neither waits, locks or allocates. Older values are overwritten.
template <typename T>
class LatestValue {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  void store(const T& value) {
    slots_[back_] = value;
    back_ = middle_.exchange(back_ | kNew, std::memory_order_acq_rel) & kIndex;
  }
  /// Returns false, and changes nothing, if no value was stored since the last call.
  bool load(T& out) {
    if ((middle_.load(std::memory_order_relaxed) & kNew) == 0) return false;
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & kIndex;
    out = slots_[front_];
    return true;
  }

 private:
  static constexpr std::uint8_t kIndex = 3, kNew = 4;
  std::array<T, 3> slots_{};
  std::uint8_t back_ = 0;   // of the thread that stores
  std::uint8_t front_ = 2;  // of the thread that loads
  std::atomic<std::uint8_t> middle_{1};
};

}  // namespace softhand
