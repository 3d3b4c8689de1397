#include "runtime/phase_lock.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace softhand {
namespace {

constexpr Nanoseconds kLongestSilence = 1'000'000'000;
constexpr double kLeastResultant = 0.8;
constexpr double kGain = 0.1;            // of the remaining distance per step
constexpr double kLargestShift = 0.005;  // of the period; a simulation that moves its grid runs so much too fast

// `value` in -period/2 .. period/2.
Nanoseconds wrapped(Nanoseconds value, Nanoseconds period) {
  const Nanoseconds rest = ((value % period) + period) % period;
  return rest > period / 2 ? rest - period : rest;
}

}  // namespace

Nanoseconds PhaseLock::follow(Nanoseconds due, Nanoseconds arrival) {
  if (arrival > newest_ && std::abs(due - arrival) < kLongestSilence) {
    waits_[count_++ % kWindow] = wrapped(due - arrival - moved_, period_);
    newest_ = arrival;
  } else if (due - newest_ >= kLongestSilence) {
    count_ = 0;
    newest_ = 0;
    found_ = false;
  }
  locked_ = false;
  wait_ = 0;
  if (count_ < kWindow) return 0;
  const double angle_per_ns = 2 * std::numbers::pi / static_cast<double>(period_);
  double x = 0, y = 0;
  for (const Nanoseconds wait : waits_) {
    x += std::cos(angle_per_ns * static_cast<double>(wait));
    y += std::sin(angle_per_ns * static_cast<double>(wait));
  }
  locked_ = std::hypot(x, y) >= kLeastResultant * kWindow;
  if (!locked_) return 0;
  const auto mean = static_cast<Nanoseconds>(std::atan2(y, x) / angle_per_ns);
  std::array<Nanoseconds, kWindow> around;
  std::transform(waits_.begin(), waits_.end(), around.begin(),
                 [&](Nanoseconds wait) { return wrapped(wait - mean, period_); });
  auto* const low = around.begin() + kWindow / 10;
  std::nth_element(around.begin(), low, around.end());
  const Nanoseconds late = wrapped(mean + *low + moved_ - margin_, period_);
  wait_ = margin_ + late;
  const auto limit = static_cast<Nanoseconds>(kLargestShift * static_cast<double>(period_));
  Nanoseconds shift = -late;  // a new source: one step is irregular, which is better than a second of late steps
  if (std::exchange(found_, true))
    shift = std::clamp(static_cast<Nanoseconds>(-kGain * static_cast<double>(late)), -limit, limit);
  moved_ += shift;
  return shift;
}

}  // namespace softhand
