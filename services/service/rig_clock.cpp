#include "service/rig_clock.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string_view>

#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "runtime/scheduling.hpp"
#include "service/time_control.hpp"

namespace softhand {
namespace {

using std::chrono::milliseconds;

constexpr Nanoseconds kDiscovery = 500'000'000;
constexpr Nanoseconds kStatusWait = 1'000'000'000;   // ten periods of the statuses
constexpr Nanoseconds kForeignWait = 5'000'000'000;  // until the clock of another host is known
constexpr Nanoseconds kListening = 2'000'000'000;
constexpr Nanoseconds kLongest = 10'000'000'000;  // also without a status of this process
// s. While a command takes effect, statuses of two modules may be from before and after it. They differ by less.
constexpr double kTolerance = 0.25;

Nanoseconds nanoseconds(double seconds) { return std::llround(1e9 * seconds); }

void listen(const std::stop_token& stop, bus::Reader<LoopStatus>& statuses, std::uint64_t epoch,
            const std::string& module) {
  std::optional<SimulatedClock> own;
  Nanoseconds end = now() + kLongest;
  bool differs = false;
  while (!stop.stop_requested() && !differs && now() < end) {
    statuses.wait(milliseconds(50));
    statuses.take_all([&](const LoopStatus& status) {
      const std::optional<SimulatedClock> clock = clock_of(status);
      if (status.stamp.epoch == epoch) {
        if (!own) end = now() + (clock ? kListening : 0);
        own = clock;
        return;
      }
      if (differs || !own || !clock) return;
      const Nanoseconds at = now();
      const double difference = static_cast<double>(own->at(at) - clock->at(at)) * kSecondsPerNanosecond;
      if (std::abs(difference) <= kTolerance) return;
      differs = true;
      const std::string_view other = get_text(status.module);
      std::fprintf(stderr,
                   "%s: the simulated clock of module %.*s is %.3f s %s that of this process; expected one clock in "
                   "all modules. Start the process again whose clock is wrong\n",
                   module.c_str(), static_cast<int>(other.size()), other.data(), std::abs(difference),
                   difference > 0 ? "behind" : "ahead of");
    });
  }
}

}  // namespace

void add_clock(LoopStatus& status, const SimulatedClock& clock, Nanoseconds now) {
  add_counter(status, "pace", clock.pace(now));
  add_counter(status, "behind_s", static_cast<double>(now - clock.at(now)) * kSecondsPerNanosecond);
  const Nanoseconds halt = clock.halt(now);
  if (halt != SimulatedClock::kNever)
    add_counter(status, "halts_in_s", static_cast<double>(halt - now) * kSecondsPerNanosecond);
}

std::optional<SimulatedClock> clock_of(const LoopStatus& status) {
  const std::optional<double> pace = find_counter(status, "pace"), behind = find_counter(status, "behind_s"),
                              halts_in = find_counter(status, "halts_in_s");
  // The clock of another host may not be known yet.
  const bool is_own_clock = status.stamp.clock_id == 0 || status.stamp.clock_id == clock_id();
  const Nanoseconds at = status.stamp.sample_time;
  if (!pace || !behind || !is_own_clock || at <= 0) return std::nullopt;
  const double longest = static_cast<double>(at) * kSecondsPerNanosecond;
  if (!(*pace >= 0 && *pace <= 1) || !(*behind >= 0 && *behind <= longest)) return std::nullopt;
  if (halts_in && !(*halts_in >= 0 && *halts_in <= TimeControl::kLongestAdvance)) return std::nullopt;
  return SimulatedClock(at, at - nanoseconds(*behind), *pace,
                        halts_in ? at + nanoseconds(*halts_in) : SimulatedClock::kNever);
}

SimulatedClock find_clock(const bus::Participant& participant) {
  if (const char* text = std::getenv(kClockVariable)) return SimulatedClock::from_text(text);
  bus::Reader statuses(participant, bus::topics::loop_status);
  std::optional<SimulatedClock> clock;
  const Nanoseconds start = now();
  Nanoseconds wait = kDiscovery;
  while (!clock && now() - start < wait) {
    if (statuses.writer_count() > 0) wait = std::max(wait, kStatusWait);
    if (statuses.counters().refused_stamp > 0) wait = kForeignWait;
    statuses.wait(milliseconds(20));
    statuses.take_all([&clock](const LoopStatus& status) {
      if (!clock) clock = clock_of(status);
    });
  }
  return clock.value_or(SimulatedClock());
}

ClockCheck::ClockCheck(const bus::Participant& participant, const std::string& module)
    : thread_([statuses = bus::Reader(participant, bus::topics::loop_status), epoch = participant.epoch(),
               module](const std::stop_token& stop) mutable {
        become_ordinary();
        listen(stop, statuses, epoch, module);
      }) {}

}  // namespace softhand
