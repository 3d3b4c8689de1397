// Hands records from a real-time loop to a thread beside it, which may wait, allocate and write.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "runtime/scheduling.hpp"

namespace softhand {

/// Single producer.
template <typename Record>
class OffLoop {
  static_assert(std::is_trivially_copyable_v<Record>);

 public:
  /// Room for `capacity` records. `handle` runs in the thread, once for each record, oldest first. The producer must
  /// not spend time on waking the thread, so the thread looks for records every `period`.
  OffLoop(std::size_t capacity, std::chrono::milliseconds period, std::function<void(const Record&)> handle)
      : slots_(capacity), period_(period), handle_(std::move(handle)), thread_([this] {
          become_ordinary();
          run();
        }) {}
  /// Handles the remaining records.
  ~OffLoop() {
    stop_.store(true, std::memory_order_release);
    thread_.join();
  }
  OffLoop(const OffLoop&) = delete;
  OffLoop& operator=(const OffLoop&) = delete;

  /// Never waits or allocates. False if there is no room.
  bool push(const Record& record) {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail - head_.load(std::memory_order_acquire) == slots_.size()) return false;
    slots_[tail % slots_.size()] = record;
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

 private:
  void drain() {
    std::size_t head = head_.load(std::memory_order_relaxed);
    const std::size_t tail = tail_.load(std::memory_order_acquire);
    for (; head != tail; ++head) {
      handle_(slots_[head % slots_.size()]);
      head_.store(head + 1, std::memory_order_release);
    }
  }
  void run() {
    while (!stop_.load(std::memory_order_acquire)) {
      drain();
      std::this_thread::sleep_for(period_);
    }
    drain();
  }

  std::vector<Record> slots_;
  std::chrono::milliseconds period_;
  std::function<void(const Record&)> handle_;
  std::atomic<std::size_t> head_{0};
  std::atomic<std::size_t> tail_{0};
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace softhand
