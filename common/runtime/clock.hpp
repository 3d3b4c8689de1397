// The time used in stamps, and ids for clocks and processes.
#pragma once

#include <cstdint>

#include "messages/messages.hpp"

namespace softhand {

/// CLOCK_MONOTONIC in nanoseconds. All processes of a host share it. Changes of the wall clock do not affect it. Does
/// not allocate.
Nanoseconds now();

/// Identifies the host and its boot: a hash of the kernel's boot id, never 0. Reads a file, so call it before the loop
/// starts.
std::uint32_t clock_id();

/// A random number, never 0, for `Stamp::epoch`. Call it once per process.
std::uint64_t make_epoch();

}  // namespace softhand
