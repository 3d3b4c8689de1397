// A second thread for work that falls into two halves, for loops that must not wait: nothing is allocated or locked
// after construction.
#pragma once

#include <pthread.h>
#include <sched.h>

#include <atomic>
#include <cstdint>
#include <thread>
#include <type_traits>

namespace softhand {

/// One caller at a time. The helper spins for half a millisecond after its last work, then sleeps until there is more.
class HelperThread {
 public:
  /// Pins the calling thread to the core that it is on, and the helper to another that the calling thread may use, with
  /// the same scheduling: two that spin on one core would wait for each other. Where there is no other core there is no
  /// helper, and all work is the caller's.
  HelperThread();
  /// The calling thread may again use the cores that it could.
  ~HelperThread();
  HelperThread(const HelperThread&) = delete;
  HelperThread& operator=(const HelperThread&) = delete;

  bool present() const { return thread_.joinable(); }
  /// There will be work soon: a helper that sleeps takes tens of microseconds to wake.
  void wake();

  /// first() here and second() at the same time on the helper; both here where the helper has not begun when first() is
  /// done. Returns when both are done.
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
  bool withdraw();  ///< false where the helper has begun
  void await();
  void serve();

  void (*work_)(void*) = nullptr;
  void* context_ = nullptr;
  std::atomic<std::uint32_t> state_{kIdle};
  std::atomic<std::uint32_t> offers_{0};  // what a sleeping helper waits for
  std::atomic<bool> stop_{false};
  pthread_t caller_{};
  cpu_set_t callers_cores_{};
  std::thread thread_;
};

/// HelperThread::run, or one after the other without a helper.
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
