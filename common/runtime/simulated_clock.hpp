// The clock of the simulation. It can run slower than the real clock, stop and continue. Every process of a rig
// computes it from the same commands, so all read the same time without communication.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <string>
#include <string_view>

#include "messages/messages.hpp"

namespace softhand {

/// Maps real time (`now()`, ns) to simulated time. The function is continuous and never decreases. Until the first
/// command it equals real time. Only `text` allocates.
class SimulatedClock {
 public:
  static constexpr Nanoseconds kNever = std::numeric_limits<Nanoseconds>::max();

  SimulatedClock() = default;
  /// A clock that runs already: it shows `simulated` at real time `from`, and continues as after `command`.
  SimulatedClock(Nanoseconds from, Nanoseconds simulated, double pace, Nanoseconds until = kNever);

  /// From real time `from` on, a simulated second takes 1/pace real seconds. With `pace` 0 the clock stops. It also
  /// stops at `until`. Commands may come in any order: each one holds until the command with the next later `from`.
  /// Commands older than the last eight are ignored.
  void command(Nanoseconds from, double pace, Nanoseconds until = kNever);

  Nanoseconds at(Nanoseconds real) const;
  /// Real time at which the clock reaches `simulated`, accurate to a few nanoseconds. kNever if the current commands do
  /// not reach it.
  Nanoseconds when(Nanoseconds simulated) const;
  /// Simulated seconds per real second at real time `real`.
  double pace(Nanoseconds real) const;
  /// Real time at which the clock stops, by the command that is in effect at `real`. It is kNever if the clock does not
  /// run then, or runs without an end.
  Nanoseconds halt(Nanoseconds real) const;

  /// All commands on one line. A process that starts later reads them with `from_text`.
  std::string text() const;
  /// Throws std::invalid_argument if `text` is not a result of `text()`.
  static SimulatedClock from_text(std::string_view text);

 private:
  struct Command {
    Nanoseconds from = 0;
    Nanoseconds until = kNever;
    double pace = 1;
    Nanoseconds simulated = 0;  // at `from`
  };
  static Nanoseconds at(const Command& command, Nanoseconds real);
  const Command& in_effect(Nanoseconds real) const;

  std::array<Command, 9> commands_{};  // ascending by `from`; the first one also holds for all earlier times
  std::size_t count_ = 1;
};

}  // namespace softhand
