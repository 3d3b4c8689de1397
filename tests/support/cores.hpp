// The number of cores that the calling thread may use. taskset or a container may allow only some of the machine's
// cores.
#pragma once

#include <pthread.h>
#include <sched.h>

namespace softhand::testing {

inline int allowed_cores() {
  cpu_set_t cores;
  CPU_ZERO(&cores);
  pthread_getaffinity_np(pthread_self(), sizeof(cores), &cores);
  return CPU_COUNT(&cores);
}

}  // namespace softhand::testing
