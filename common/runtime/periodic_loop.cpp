#include "runtime/periodic_loop.hpp"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <cstring>
#include <ctime>
#include <stdexcept>

namespace softhand {
namespace {

constexpr std::size_t kThreadStack = std::size_t{1} << 20;

Nanoseconds period_of(double rate_hz) {
  if (!(rate_hz >= 0.1 && rate_hz <= 100'000))
    throw std::invalid_argument("loop rate: expected 0.1 to 100000 Hz, got " + std::to_string(rate_hz));
  return static_cast<Nanoseconds>(std::llround(1e9 / rate_hz));
}

}  // namespace

PeriodicLoop::PeriodicLoop(double rate_hz) : rate_hz_(rate_hz), period_(period_of(rate_hz)), schedule_(0, period_) {}

void PeriodicLoop::sleep_until(Nanoseconds time) {
  const timespec wake{time / 1'000'000'000, static_cast<long>(time % 1'000'000'000)};
  // If a signal interrupts the sleep, continue to sleep: a step must not start early. The loop sees a stop request at
  // the end of the period.
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &wake, nullptr) == EINTR) {
  }
}

void PeriodicLoop::fill(LoopStatus& status) const {
  status.process_id = static_cast<std::uint32_t>(getpid());
  status.rate_hz = step_times_.rate();
  status.nominal_rate_hz = rate_hz_;
  status.step_ms_p50 = static_cast<double>(step_times_.quantile(0.5)) * 1e-6;
  status.step_ms_p99 = static_cast<double>(step_times_.quantile(0.99)) * 1e-6;
  status.step_ms_p999 = static_cast<double>(step_times_.quantile(0.999)) * 1e-6;
  status.steps = steps_;
  status.deadline_misses = schedule_.misses();
}

std::vector<std::string> request_real_time(int priority) {
  std::vector<std::string> warnings;
#if defined(__GLIBC__)
  // Locked memory is resident, and this includes stacks. With glibc's default of 8 MB per thread, the stacks of a DDS
  // participant's threads would be half of a service's memory.
  pthread_attr_t attributes;
  pthread_attr_init(&attributes);
  pthread_attr_setstacksize(&attributes, kThreadStack);
  if (const int error = pthread_setattr_default_np(&attributes); error != 0) {
    warnings.push_back(std::string("stacks stay large (") + std::strerror(error) + ")");
  }
  pthread_attr_destroy(&attributes);
#endif
  if (mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    warnings.push_back(std::string("memory is not locked (") + std::strerror(errno) + "): steps may wait for pages");
  }
  sched_param parameters{};
  parameters.sched_priority = priority;
  if (const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters); error != 0) {
    warnings.push_back(std::string("real-time priority refused (") + std::strerror(error) + "): steps may be late");
  }
  return warnings;
}

}  // namespace softhand
