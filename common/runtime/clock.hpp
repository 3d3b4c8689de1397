// The time that stamps carry, and what tells clocks and processes apart.
#pragma once

#include <cstdint>

#include "messages/messages.hpp"

namespace softhand {

/// CLOCK_MONOTONIC in nanoseconds: shared by all processes of a host, counts on through a change of the wall clock.
/// Does not allocate.
Nanoseconds now();

/// Tells hosts (and boots of a host) apart: a hash of the kernel's boot id, never 0. Reads a file, so call it before
/// the loop starts.
std::uint32_t clock_id();

/// A random number, never 0, for `Stamp::epoch`: call it once a process.
std::uint64_t make_epoch();

}  // namespace softhand
