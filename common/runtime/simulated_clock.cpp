#include "runtime/simulated_clock.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace softhand {

SimulatedClock::SimulatedClock(Nanoseconds from, Nanoseconds simulated, double pace, Nanoseconds until) {
  commands_[0] = {from, until, pace, simulated};
}

Nanoseconds SimulatedClock::at(const Command& command, Nanoseconds real) {
  const Nanoseconds elapsed = std::min(real, command.until) - command.from;
  // A double represents nanoseconds exactly for up to 104 days. This is enough for a slowed interval, but not for the
  // time since the host's start. So pace 1 uses integers.
  if (command.pace == 1) return command.simulated + elapsed;
  return command.simulated + static_cast<Nanoseconds>(std::floor(command.pace * static_cast<double>(elapsed)));
}

void SimulatedClock::command(Nanoseconds from, double pace, Nanoseconds until) {
  std::size_t place = count_;
  while (place > 0 && commands_[place - 1].from > from) --place;
  const bool full = count_ == commands_.size();
  if (place == 0 || (full && place == 1)) return;
  if (full) {
    std::copy(commands_.begin() + 1, commands_.end(), commands_.begin());
    --count_;
    --place;
  }
  std::copy_backward(commands_.begin() + static_cast<std::ptrdiff_t>(place),
                     commands_.begin() + static_cast<std::ptrdiff_t>(count_),
                     commands_.begin() + static_cast<std::ptrdiff_t>(count_ + 1));
  ++count_;
  commands_[place] = {from, until, pace, 0};
  for (; place < count_; ++place) commands_[place].simulated = at(commands_[place - 1], commands_[place].from);
}

const SimulatedClock::Command& SimulatedClock::in_effect(Nanoseconds real) const {
  std::size_t i = count_ - 1;
  while (i > 0 && commands_[i].from > real) --i;
  return commands_[i];
}

Nanoseconds SimulatedClock::at(Nanoseconds real) const { return at(in_effect(real), real); }

Nanoseconds SimulatedClock::when(Nanoseconds simulated) const {
  for (std::size_t i = 0; i < count_; ++i) {
    const Command& command = commands_[i];
    const Nanoseconds end = i + 1 < count_ ? commands_[i + 1].from : kNever;
    const Nanoseconds last = std::min(end, command.until);
    const Nanoseconds ahead = simulated - command.simulated;
    if (command.pace == 0) {
      if (ahead <= 0) return command.from;
      continue;
    }
    const Nanoseconds real =
        command.from +
        (command.pace == 1 ? ahead : static_cast<Nanoseconds>(std::ceil(static_cast<double>(ahead) / command.pace)));
    if (real <= last) return real;
  }
  return kNever;
}

double SimulatedClock::pace(Nanoseconds real) const {
  const Command& command = in_effect(real);
  return real < command.until ? command.pace : 0;
}

Nanoseconds SimulatedClock::halt(Nanoseconds real) const { return pace(real) > 0 ? in_effect(real).until : kNever; }

std::string SimulatedClock::text() const {
  std::ostringstream out;
  out.precision(17);
  out << commands_[0].simulated;
  for (std::size_t i = 0; i < count_; ++i)
    out << ' ' << commands_[i].from << ' ' << commands_[i].pace << ' ' << commands_[i].until;
  return out.str();
}

SimulatedClock SimulatedClock::from_text(std::string_view text) {
  std::istringstream in{std::string(text)};
  SimulatedClock clock;
  clock.count_ = 0;
  in >> clock.commands_[0].simulated;
  for (Command next; in >> next.from;) {
    if (!(in >> next.pace >> next.until) || !(next.pace >= 0 && next.pace <= 1) || next.until < next.from) break;
    if (clock.count_ > 0) {
      clock.command(next.from, next.pace, next.until);
      continue;
    }
    next.simulated = clock.commands_[0].simulated;
    clock.commands_[clock.count_++] = next;
  }
  // A text that does not round-trip was truncated or not written by text().
  if (clock.count_ == 0 || text != clock.text())
    throw std::invalid_argument("not a valid simulated clock: '" + std::string(text) + "'");
  return clock;
}

}  // namespace softhand
