// The clock of the simulation, which may run slower than the real one, stand, and go on. Every process of a rig
// computes it from the same commands and so reads the same time, without any process being asked.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <string>
#include <string_view>

#include "messages/messages.hpp"

namespace softhand {

/// A function of the real time (`now()`, ns): continuous, never falling, real time itself until the first command.
/// Nothing allocates but `text`.
class SimulatedClock {
 public:
  static constexpr Nanoseconds kNever = std::numeric_limits<Nanoseconds>::max();

  /// From real time `from` on, a simulated second takes 1/pace real ones; `pace` 0 stands still. From `until` on it
  /// stands in any case. The order of calls does not matter: a command holds until the next one by `from`. One that is
  /// older than the last eight is forgotten.
  void command(Nanoseconds from, double pace, Nanoseconds until = kNever);

  Nanoseconds at(Nanoseconds real) const;
  /// The real time at which `simulated` is reached, to a few nanoseconds; kNever where the present commands do not
  /// reach it.
  Nanoseconds when(Nanoseconds simulated) const;
  /// Simulated seconds a real one, at real time `real`.
  double pace(Nanoseconds real) const;

  /// All that is known, on one line: how a process that starts later learns of it (`from_text`).
  std::string text() const;
  /// Throws std::invalid_argument where `text` is not of `text()`.
  static SimulatedClock from_text(std::string_view text);

 private:
  struct Command {
    Nanoseconds from = 0;
    Nanoseconds until = kNever;
    double pace = 1;
    Nanoseconds simulated = 0;  // at `from`
  };
  static Nanoseconds at(const Command& command, Nanoseconds real);

  std::array<Command, 9> commands_{};  // ascending; the first holds for all times before the second, too
  std::size_t count_ = 1;
};

}  // namespace softhand
