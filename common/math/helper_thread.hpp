// A second thread for work that splits into two halves. Meant for real-time loops: it does not allocate or lock after
// construction.
#pragma once

#include <pthread.h>
#include <sched.h>

#include <atomic>
#include <cstdint>
#include <thread>
#include <type_traits>

namespace softhand {

/// Supports one caller at a time. After its last work the helper spins for half a millisecond and then sleeps until the
/// next work.
class HelperThread {
 public:
  /// Pins the calling thread to its current core. Pins the helper to another core that the calling thread may use, with
  /// the same scheduling. On one core, two spinning threads would wait for each other. If no other core is
  /// available, there is no helper and the caller does all the work.
  HelperThread();
  /// Restores the set of cores that the calling thread may use.
  ~HelperThread();
  HelperThread(const HelperThread&) = delete;
  HelperThread& operator=(const HelperThread&) = delete;

  bool present() const { return thread_.joinable(); }
  /// Wakes the helper ahead of work. A sleeping helper needs tens of microseconds to wake.
  void wake();

  /// Runs first() in the calling thread and second() at the same time in the helper. If the helper has not begun when
  /// first() ends, the calling thread runs second() too. Returns when both are done.
  template <typename First, typename Second>
  void run(First&& first, Second&& second) {
    using Work = std::remove_reference_t<Second>;
    if (present()) offer([](void* work) { (*static_cast<Work*>(work))(); }, &second);
    first();
    if (!present() || withdraw()) {
      second();
    } else {
      await();
    }
  }

 private:
  enum State : std::uint32_t { kIdle, kOffered, kTaken, kDone };

  void offer(void (*work)(void*), void* context);
  bool withdraw();  ///< false if the helper has begun
  void await();
  void serve();

  void (*work_)(void*) = nullptr;
  void* context_ = nullptr;
  std::atomic<std::uint32_t> state_{kIdle};
  std::atomic<std::uint32_t> offers_{0};  // a sleeping helper waits for a change of this counter
  std::atomic<bool> stop_{false};
  pthread_t caller_{};
  cpu_set_t callers_cores_{};
  std::thread thread_;
};

/// Calls HelperThread::run; without a helper, runs both parts one after the other.
template <typename First, typename Second>
void run_halves(HelperThread* helper, First&& first, Second&& second) {
  if (helper != nullptr) {
    helper->run(first, second);
  } else {
    first();
    second();
  }
}

}  // namespace softhand
