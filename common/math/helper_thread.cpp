#include "math/helper_thread.hpp"

#include <chrono>

namespace softhand {
namespace {

constexpr std::chrono::microseconds kSpinTime{500};

void relax() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#endif
}

}  // namespace

HelperThread::HelperThread() : caller_(pthread_self()) {
  const int here = sched_getcpu();
  if (here < 0 || pthread_getaffinity_np(caller_, sizeof(callers_cores_), &callers_cores_) != 0) return;
  int other = -1;
  for (int core = 0; core < CPU_SETSIZE && other < 0; ++core) {
    if (core != here && CPU_ISSET(core, &callers_cores_)) other = core;
  }
  cpu_set_t mine, its;
  CPU_ZERO(&mine);
  CPU_SET(here, &mine);
  if (other < 0 || pthread_setaffinity_np(caller_, sizeof(mine), &mine) != 0) return;
  thread_ = std::thread([this] { serve(); });
  CPU_ZERO(&its);
  CPU_SET(other, &its);
  pthread_setaffinity_np(thread_.native_handle(), sizeof(its), &its);
}

HelperThread::~HelperThread() {
  if (!present()) return;
  stop_.store(true);
  wake();
  thread_.join();
  if (pthread_equal(caller_, pthread_self()) != 0)
    pthread_setaffinity_np(caller_, sizeof(callers_cores_), &callers_cores_);
}

void HelperThread::wake() {
  offers_.fetch_add(1);
  offers_.notify_one();
}

void HelperThread::offer(void (*work)(void*), void* context) {
  work_ = work;
  context_ = context;
  state_.store(kOffered);
  wake();
}

bool HelperThread::withdraw() {
  std::uint32_t expected = kOffered;
  return state_.compare_exchange_strong(expected, kIdle);
}

void HelperThread::await() {
  while (state_.load(std::memory_order_acquire) != kDone) relax();
}

void HelperThread::serve() {
  using Clock = std::chrono::steady_clock;
  Clock::time_point spin_until = Clock::now() + kSpinTime;
  while (!stop_.load()) {
    const std::uint32_t seen = offers_.load();
    std::uint32_t expected = kOffered;
    if (state_.compare_exchange_strong(expected, kTaken)) {
      work_(context_);
      state_.store(kDone, std::memory_order_release);
      spin_until = Clock::now() + kSpinTime;
    } else if (Clock::now() < spin_until) {
      for (int i = 0; i < 32; ++i) relax();
    } else {
      offers_.wait(seen);  // returns at once if an offer changed the counter after `seen` was read
      spin_until = Clock::now() + kSpinTime;
    }
  }
}

}  // namespace softhand
