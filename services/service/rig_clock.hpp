// A process that starts after a `pace` or `advance` (time_control.hpp) takes over the simulated clock of the modules
// that run already. `softhand up` gives it to its processes as SOFTHAND_CLOCK. Other processes read it from the
// statuses of these modules.
#pragma once

#include <optional>
#include <string>
#include <thread>

#include "bus/bus.hpp"
#include "messages/messages.hpp"
#include "runtime/simulated_clock.hpp"

namespace softhand {

/// Adds `pace`, `behind_s` (how far `clock` is behind real time) and, while an `advance` runs, `halts_in_s` (until it
/// halts) to `status.counters`, at real time `now`. Real-time safe.
void add_clock(LoopStatus& status, const SimulatedClock& clock, Nanoseconds now);

/// The clock from these counters. Empty if the module has no simulated clock, or if a counter is out of range. Also
/// empty if the time of its status is not known on this host.
std::optional<SimulatedClock> clock_of(const LoopStatus& status);

/// Environment variable with the commanded state of the clock. `softhand up` sets it for its processes.
inline constexpr const char* kClockVariable = "SOFTHAND_CLOCK";

/// The clock for a new process: that of SOFTHAND_CLOCK, else that of the first module that is heard, else real time.
/// Waits up to 0.5 s for modules. If there are some, it waits up to 1 s for a status. If this comes from another host,
/// it waits up to 5 s for the clock of that host. Call it before `participant` writes statuses. Throws
/// std::invalid_argument if the value of SOFTHAND_CLOCK is not a clock.
SimulatedClock find_clock(const bus::Participant& participant);

class ClockCheck {
 public:
  /// Listens in a thread beside the loop, until 2 s after the first status of this process, which is called `module`.
  /// If the clock of another module differs, one line on stderr names that module.
  ClockCheck(const bus::Participant& participant, const std::string& module);

 private:
  std::jthread thread_;
};

}  // namespace softhand
