#include "math/helper_thread.hpp"

#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <cstdio>

namespace softhand {
namespace {

constexpr std::chrono::microseconds kSpinTime{500};

void relax() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#endif
}

}  // namespace

CoreClaim::CoreClaim(int core) {
  sockaddr_un name{};
  name.sun_family = AF_UNIX;
  // A name that starts with a zero belongs to no folder. It disappears with its socket.
  const int length = std::snprintf(name.sun_path + 1, sizeof(name.sun_path) - 1, "softhand/core/%d", core);
  socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + 1 + static_cast<std::size_t>(length));
  if (socket_ >= 0 && bind(socket_, reinterpret_cast<const sockaddr*>(&name), size) != 0)
    close(std::exchange(socket_, -1));
}

CoreClaim::~CoreClaim() {
  if (socket_ >= 0) close(socket_);
}

CorePair choose_cores(const cpu_set_t& allowed, int here, const std::function<bool(int)>& claim) {
  const auto find = [&allowed](int except, auto&& accepts) {
    for (int core = 0; core < CPU_SETSIZE; ++core) {
      if (core != except && CPU_ISSET(core, &allowed) && accepts(core)) return core;
    }
    return -1;
  };
  CorePair cores{.caller = claim(here) ? here : find(here, claim)};
  if (cores.caller < 0) {
    cores.caller = here;
  } else {
    cores.helper = find(cores.caller, claim);
  }
  if (cores.helper < 0) cores.helper = find(cores.caller, [](int) { return true; });
  return cores;
}

HelperThread::HelperThread() : caller_(pthread_self()) {
  const int here = sched_getcpu();
  if (here < 0 || pthread_getaffinity_np(caller_, sizeof(callers_cores_), &callers_cores_) != 0) return;
  const CorePair cores = choose_cores(callers_cores_, here, [this](int core) {
    CoreClaim claim(core);
    if (!claim.holds()) return false;
    (callers_claim_.holds() ? helpers_claim_ : callers_claim_) = std::move(claim);
    return true;
  });
  cpu_set_t mine, its;
  CPU_ZERO(&mine);
  CPU_SET(cores.caller, &mine);
  if (cores.helper < 0 || pthread_setaffinity_np(caller_, sizeof(mine), &mine) != 0) {
    callers_claim_ = {};
    return;
  }
  // A real-time loop may be set to start only ordinary threads.
  const int policy = sched_getscheduler(0), niceness = getpriority(PRIO_PROCESS, 0);
  sched_param parameters{};
  sched_getparam(0, &parameters);
  thread_ = std::thread([this, policy, niceness, parameters] {
    sched_setscheduler(0, policy, &parameters);
    setpriority(PRIO_PROCESS, 0, niceness);
    serve();
  });
  pthread_setname_np(thread_.native_handle(), "helper");
  CPU_ZERO(&its);
  CPU_SET(cores.helper, &its);
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
