// Pausing, slowing down and starting over a whole rig. The commands are messages to all modules. Each takes effect a
// moment after it was sent, at a time told by its own stamp, so that all processes of a host do the same at the same
// time though they hear of it one after another.
#pragma once

#include <optional>
#include <string_view>

#include "runtime/simulated_clock.hpp"

namespace softhand {

class TimeControl {
 public:
  /// From a command's sending to its effect: more than a message takes, less than a person notices.
  static constexpr Nanoseconds kNotice = 100'000'000;
  /// Environment variable by which `softhand up` tells processes that it starts later what the clock was commanded
  /// before.
  static constexpr const char* kVariable = "SOFTHAND_CLOCK";

  /// Reads SOFTHAND_CLOCK; throws std::invalid_argument where it holds no clock.
  TimeControl();

  /// Answers `pace` (0 = stand, 1 = real time), `advance` (simulated seconds at real time, then stand) and `reset` (any
  /// value); none to other messages. `now`: real time. Real-time.
  std::optional<MessageReply> answer(const Message& message, std::string_view module, Nanoseconds now);

  const SimulatedClock& clock() const { return clock_; }
  /// Once for the newest `reset` that is in effect at real time `now`: the simulated time at which it came. What was
  /// sampled until then belongs to before.
  std::optional<Nanoseconds> take_reset(Nanoseconds now);

 private:
  SimulatedClock clock_;
  std::optional<Nanoseconds> reset_;  // real time
};

}  // namespace softhand
