#include "runtime/periodic_loop.hpp"

#include <unistd.h>

#include <cerrno>
#include <cmath>
#include <ctime>
#include <stdexcept>

namespace softhand {
namespace {

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

}  // namespace softhand
