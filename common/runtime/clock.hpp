// The time used in stamps, and ids for clocks and processes.
#pragma once

#include <cstdint>

#include "messages/messages.hpp"

namespace softhand {

/// CLOCK_MONOTONIC in nanoseconds. All processes of a host share it. Changes of the wall clock do not affect it. Does
/// not allocate.
Nanoseconds now();

/// Identifies the clock behind `now()`: a hash of the kernel's boot id, and of the offset that a time namespace adds.
/// Never 0. Reads files, so call it before the loop starts.
std::uint32_t clock_id();

/// The wall clock (CLOCK_REALTIME) against `now()`.
struct WallClock {
  Nanoseconds offset = 0;   ///< wall clock minus `now()`
  double uncertainty = -1;  ///< s, as the kernel estimates it; negative: neither PTP nor NTP keeps the clock
};
WallClock wall_clock();

/// A random number, never 0, for `Stamp::epoch`. Call it once per process.
std::uint64_t make_epoch();

}  // namespace softhand
