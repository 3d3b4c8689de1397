// The thread of a device whose SDK blocks, allocates or wants one thread for itself. The counterpart of Intake.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <string_view>
#include <thread>
#include <utility>

#include "device/arrival_queue.hpp"
#include "device/intake.hpp"
#include "messages/messages.hpp"

namespace softhand {

class DeviceThread {
 public:
  /// Opens the device, calls `opened`, pushes packets until the device is lost or `stops`, and closes the device. It is
  /// called again after a time that grows: see Backoff. An exception ends a session too; its text is printed once.
  using Session = std::function<void(DeviceThread&)>;

  /// `largest` and `slots` as those of an intake.
  explicit DeviceThread(std::size_t largest, std::size_t slots = Intake::kDefaultSlots) : queue_(largest, slots) {}
  ~DeviceThread();
  void start(Session session);

  // For the session.
  bool stops() const { return stop_; }
  /// Waits, but not longer than until the thread stops.
  void sleep(Nanoseconds time) const;
  void opened();
  /// `time`: when the packet arrived.
  void push(std::string_view bytes, Nanoseconds time) { queue_.push({bytes, time, opened_, true}); }

  // For the loop. These do not block or allocate.
  template <typename F>
  void take(F&& f) {
    queue_.take(std::forward<F>(f));
  }
  bool connected() const { return is_open_; }
  Intake::Counters counters() const;
  /// Adds passed_over, connections and reconnects.
  void fill_status(LoopStatus& status) const;

 private:
  ArrivalQueue queue_;
  std::atomic<bool> stop_{false}, is_open_{false};
  std::atomic<std::uint64_t> opened_{0};
  std::thread thread_;
};

}  // namespace softhand
