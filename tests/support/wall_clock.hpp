// A wall clock that is wrong. The monotonic clock stays right.
#pragma once

#include <time.h>

namespace softhand::testing {

/// Error of the wall clock for the calling thread and its libraries, s. It begins with WALL_CLOCK_SHIFT of the
/// environment, or 0.
extern thread_local time_t wall_clock_shift;

}  // namespace softhand::testing
