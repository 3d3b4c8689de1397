// Compares the simulated clock of a new process with the clocks of the modules that run already. A process that starts
// after a `pace` or `advance`, without SOFTHAND_CLOCK, does not know these commands (time_control.hpp).
#pragma once

#include <optional>
#include <string>
#include <thread>

#include "bus/bus.hpp"
#include "messages/messages.hpp"

namespace softhand {

/// Seconds by which the simulated clock of the module `other` is behind that of `own`, when the later of both statuses
/// was taken. Empty if a module has no simulated clock, or if the time of its status is not known.
std::optional<double> clock_difference(const LoopStatus& own, const LoopStatus& other);

class ClockCheck {
 public:
  /// Listens in a thread beside the loop, until 2 s after the first status of this process, which is called `module`.
  /// If the clock of another module differs, one line on stderr names that module.
  ClockCheck(const bus::Participant& participant, const std::string& module);

 private:
  std::jthread thread_;
};

}  // namespace softhand
