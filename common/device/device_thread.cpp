#include "device/device_thread.hpp"

#include <chrono>
#include <cstdio>
#include <exception>
#include <string>

#include "device/health.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "runtime/scheduling.hpp"

namespace softhand {

DeviceThread::~DeviceThread() {
  stop_ = true;
  if (thread_.joinable()) thread_.join();
}

void DeviceThread::start(Session session) {
  thread_ = std::thread([this, session = std::move(session)] {
    become_ordinary();
    Backoff backoff;
    std::string said;
    while (!stop_) {
      std::string error;
      try {
        session(*this);
      } catch (const std::exception& exception) {
        error = exception.what();
      }
      // The user reads why the device cannot be opened, once.
      if (!error.empty() && error != said) std::fprintf(stderr, "%s\n", error.c_str());
      said = error;
      if (is_open_) backoff.reset();
      is_open_ = false;
      sleep(backoff.next());
    }
  });
}

void DeviceThread::sleep(Nanoseconds time) const {
  constexpr Nanoseconds kLongest = 20'000'000;  // until a stop is noticed
  const Nanoseconds end = now() + time;
  for (Nanoseconds left = time; left > 0 && !stop_; left = end - now())
    std::this_thread::sleep_for(std::chrono::nanoseconds(std::min(left, kLongest)));
}

void DeviceThread::opened() {
  ++opened_;
  is_open_ = true;
}

Intake::Counters DeviceThread::counters() const {
  const std::uint64_t opened = opened_;
  Intake::Counters out;
  out.connections = is_open_ ? 1 : 0;
  out.reconnects = opened > 0 ? opened - 1 : 0;
  out.passed_over = queue_.passed_over();
  return out;
}

void DeviceThread::fill_status(LoopStatus& status) const {
  const Intake::Counters now = counters();
  add_counter(status, "passed_over", static_cast<double>(now.passed_over));
  add_counter(status, "connections", static_cast<double>(now.connections));
  add_counter(status, "reconnects", static_cast<double>(now.reconnects));
}

}  // namespace softhand
