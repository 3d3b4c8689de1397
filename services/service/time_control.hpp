// Pause, slow down and restart of a whole rig. The commands are messages to all modules. Each command takes effect a
// fixed time after it was sent, computed from its own stamp. So all processes of a host act at the same time, although
// they receive the message one after another.
#pragma once

#include <optional>
#include <string_view>

#include "runtime/simulated_clock.hpp"

namespace softhand {

class TimeControl {
 public:
  /// Delay from the sending of a command to its effect: longer than a message takes, too short for a person to notice.
  static constexpr Nanoseconds kNotice = 100'000'000;
  /// s, of an `advance`.
  static constexpr double kLongestAdvance = 60;

  /// `clock`: before the first command.
  explicit TimeControl(const SimulatedClock& clock = {});

  /// Answers `pace` (0 = halt, 1 = real time), `advance` (simulated seconds in real time, then halt) and `reset` (any
  /// value). Returns nothing for other messages. `now` is real time. Real-time safe.
  std::optional<MessageReply> answer(const Message& message, std::string_view module, Nanoseconds now);

  const SimulatedClock& clock() const { return clock_; }
  /// Returns the simulated time of the newest `reset` that is in effect at real time `now`, once. Samples up to that
  /// time are from before the reset.
  std::optional<Nanoseconds> take_reset(Nanoseconds now);

 private:
  std::uint32_t clock_id_;  // of this host
  SimulatedClock clock_;
  std::optional<Nanoseconds> reset_;  // real time
};

}  // namespace softhand
