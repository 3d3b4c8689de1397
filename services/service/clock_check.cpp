#include "service/clock_check.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <string_view>
#include <utility>

#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "runtime/scheduling.hpp"

namespace softhand {
namespace {

constexpr Nanoseconds kListening = 2'000'000'000;
constexpr Nanoseconds kLongest = 10'000'000'000;  // also without a status of this process
// s. While a command takes effect, statuses of two modules may be from before and after it. They differ by less.
constexpr double kTolerance = 0.25;

/// How far the simulated clock is behind real time at the real time `at`, s.
std::optional<double> behind(const LoopStatus& status, Nanoseconds at) {
  const std::optional<double> pace = find_counter(status, "pace"), behind = find_counter(status, "behind_s");
  // The clock of another host may not be known yet.
  const bool is_own_clock = status.stamp.clock_id == 0 || status.stamp.clock_id == clock_id();
  if (!pace || !behind || !is_own_clock || status.stamp.sample_time == 0) return std::nullopt;
  return *behind + (1 - *pace) * static_cast<double>(at - status.stamp.sample_time) * kSecondsPerNanosecond;
}

void listen(const std::stop_token& stop, bus::Reader<LoopStatus>& statuses, std::uint64_t epoch,
            const std::string& module) {
  std::optional<LoopStatus> own;
  Nanoseconds end = now() + kLongest;
  bool differs = false;
  while (!stop.stop_requested() && !differs && now() < end) {
    statuses.wait(std::chrono::milliseconds(50));
    statuses.take_all([&](const LoopStatus& status) {
      if (status.stamp.epoch == epoch) {
        if (!own) end = now() + (find_counter(status, "behind_s") ? kListening : 0);
        own = status;
        return;
      }
      const std::optional<double> difference = own ? clock_difference(*own, status) : std::nullopt;
      if (differs || !difference || std::abs(*difference) <= kTolerance) return;
      differs = true;
      const std::string_view other = get_text(status.module);
      std::fprintf(
          stderr,
          "%s: the simulated clock of module %.*s is %.3f s %s that of this process; expected one clock in all "
          "modules. A new process does not know earlier `pace` and `advance`: start all processes again\n",
          module.c_str(), static_cast<int>(other.size()), other.data(), std::abs(*difference),
          *difference > 0 ? "behind" : "ahead of");
    });
  }
}

}  // namespace

std::optional<double> clock_difference(const LoopStatus& own, const LoopStatus& other) {
  const Nanoseconds at = std::max(own.stamp.sample_time, other.stamp.sample_time);
  const std::optional<double> here = behind(own, at), there = behind(other, at);
  if (!here || !there) return std::nullopt;
  return *there - *here;
}

ClockCheck::ClockCheck(const bus::Participant& participant, const std::string& module)
    : thread_([statuses = bus::Reader(participant, bus::topics::loop_status), epoch = participant.epoch(),
               module](const std::stop_token& stop) mutable {
        become_ordinary();
        listen(stop, statuses, epoch, module);
      }) {}

}  // namespace softhand
