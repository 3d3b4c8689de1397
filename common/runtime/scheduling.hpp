// Priorities and cores of threads. Only loops run at a real-time priority. Input and output never do, because they
// would stand above the loops of other processes.
#pragma once

#include <sched.h>

#include <string>
#include <vector>

namespace softhand {

/// Locks the memory of the process, if the system sets no limit to it. Threads that are started later get stacks of
/// 1 MiB. Returns one warning with the reason for each request that the system refused. Call it before other threads
/// start.
std::vector<std::string> lock_memory();

/// Threads that the calling thread starts from now on get a niceness of -15, until `request_real_time`. This is for the
/// threads that receive samples. At the niceness of other programs they wait for these. A sample is then late by up to
/// a second on a busy machine (docs/two-hands.md). Returns a warning if the system refused.
std::vector<std::string> favour_new_threads();

/// Sets the calling thread to SCHED_FIFO with `priority`, 1..99. Returns a warning if the system refused. The loop
/// still runs then, with less exact timing. Threads that it starts later are ordinary in both cases.
std::vector<std::string> request_real_time(int priority);

/// For a thread that does input or output: ordinary priority, no negative niceness, and all cores of the machine. The
/// thread that started it may be favoured, or pinned to a core.
void become_ordinary();

/// A list of cores such as "2", "0-1,3". Throws std::invalid_argument for another text, and for an empty list.
cpu_set_t parse_cores(const std::string& text);

}  // namespace softhand
