// Handing the latest value of something from one thread to another.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <type_traits>

namespace softhand {

/// Triple buffer for one writing and one reading thread. Both sides are wait-free: the writer always has a buffer of its own to fill, the
/// reader one of its own to read, and the third changes hands by one atomic exchange. The latest value wins; older ones that were never
/// read are counted. Holds three T in place: put those of big messages on the heap before the loop starts.
template <typename T>
class Mailbox {
  static_assert(std::is_trivially_copyable_v<T>);

 public:
  // Writer's side.

  /// The writer's own buffer; its content is stale, so fill all of it, then `publish`.
  T& slot() { return buffers_[back_]; }
  /// Makes the slot the latest value, and gives the writer another slot.
  void publish() {
    const std::uint8_t taken = middle_.exchange(static_cast<std::uint8_t>(back_ | kFresh), std::memory_order_acq_rel);
    if ((taken & kFresh) != 0) overwritten_.store(overwritten_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    back_ = taken & kIndex;
  }
  void write(const T& value) {
    slot() = value;
    publish();
  }

  // Reader's side.

  /// Makes `value` the latest one. True when it is new since the last call.
  bool refresh() {
    if ((middle_.load(std::memory_order_relaxed) & kFresh) == 0) return false;
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & kIndex;
    return true;
  }
  /// The value of the last `refresh` that was true; T{} before. Stays as it is until the next `refresh`.
  const T& value() const { return buffers_[front_]; }

  /// Values that were replaced before they were read. Any thread.
  std::uint64_t overwritten() const { return overwritten_.load(std::memory_order_relaxed); }

 private:
  static constexpr std::uint8_t kIndex = 3;
  static constexpr std::uint8_t kFresh = 4;  // the middle buffer was published and not read

  std::array<T, 3> buffers_{};
  alignas(64) std::atomic<std::uint8_t> middle_{1};
  alignas(64) std::uint8_t back_ = 0;  // writer's
  std::atomic<std::uint64_t> overwritten_{0};
  alignas(64) std::uint8_t front_ = 2;  // reader's
};

}  // namespace softhand
