// A second thread for work that splits into two halves. Meant for real-time loops: it does not allocate or lock after
// construction.
#pragma once

#include <pthread.h>
#include <sched.h>

#include <atomic>
#include <cstdint>
#include <functional>
#include <thread>
#include <type_traits>
#include <utility>

namespace softhand {

/// A core that a thread of this program is pinned to. Other threads and other processes of the machine see the claim
/// and choose other cores. The claim ends with the process at the latest. Processes in different network namespaces,
/// such as containers, do not see each other's claims.
class CoreClaim {
 public:
  CoreClaim() = default;
  /// Fails if another claim of this core exists.
  explicit CoreClaim(int core);
  ~CoreClaim();
  CoreClaim(CoreClaim&& other) noexcept : socket_(std::exchange(other.socket_, -1)) {}
  CoreClaim& operator=(CoreClaim&& other) noexcept {
    std::swap(socket_, other.socket_);
    return *this;
  }
  bool holds() const { return socket_ >= 0; }

 private:
  int socket_ = -1;  // bound to a name with the core's number, which the kernel gives to one socket at a time
};

/// Cores of a calling thread and its helper.
struct CorePair {
  int caller = -1;
  int helper = -1;  ///< -1: no other core is allowed
};
/// Chooses two of the allowed cores. `claim` returns true for a core that nobody else has claimed. Prefers such cores,
/// and for the caller the core `here` where it runs. If all are claimed, the caller stays and the helper takes the
/// first other core.
CorePair choose_cores(const cpu_set_t& allowed, int here, const std::function<bool(int)>& claim);

/// Supports one caller at a time. After its last work the helper spins for half a millisecond and then sleeps until the
/// next work.
class HelperThread {
 public:
  /// Pins the calling thread and the helper to two cores that the calling thread may use, with the same scheduling.
  /// They are cores that no other HelperThread of the machine uses, if there are any (`choose_cores`). On one core, two
  /// spinning threads would wait for each other. If only one core is allowed, there is no helper and the caller does
  /// all the work.
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
  CoreClaim callers_claim_, helpers_claim_;
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
