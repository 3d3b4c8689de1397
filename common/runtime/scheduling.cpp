#include "runtime/scheduling.hpp"

#include <pthread.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <sstream>
#include <stdexcept>

namespace softhand {
namespace {

constexpr std::size_t kThreadStack = std::size_t{1} << 20;
constexpr int kFavoured = -15;  // niceness

}  // namespace

std::vector<std::string> lock_memory() {
  std::vector<std::string> warnings;
#if defined(__GLIBC__)
  // Locked memory is resident, and this includes stacks. With glibc's default of 8 MB per thread, the stacks of a DDS
  // participant's threads would be half of a service's memory.
  pthread_attr_t attributes;
  pthread_attr_init(&attributes);
  pthread_attr_setstacksize(&attributes, kThreadStack);
  if (const int error = pthread_setattr_default_np(&attributes); error != 0) {
    warnings.push_back(std::string("stacks stay large (") + std::strerror(error) + ")");
  }
  pthread_attr_destroy(&attributes);
#endif
  // Under a finite limit this lock may succeed, and a later allocation then fails. With the limit 0 it succeeds only
  // for a process that needs no limit.
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  const bool is_finite = limit.rlim_cur != RLIM_INFINITY;
  const rlimit none{0, limit.rlim_max};
  if (is_finite) setrlimit(RLIMIT_MEMLOCK, &none);
  const int error = mlockall(MCL_CURRENT | MCL_FUTURE) == 0 ? 0 : errno;
  if (is_finite) setrlimit(RLIMIT_MEMLOCK, &limit);
  if (error != 0) {
    warnings.push_back(std::string("memory is not locked (") +
                       (is_finite ? "the memlock limit is finite" : std::strerror(error)) +
                       "): steps may wait for pages");
  }
  return warnings;
}

std::vector<std::string> favour_new_threads() {
  // On Linux a thread has a niceness of its own, and new threads inherit it.
  if (setpriority(PRIO_PROCESS, 0, kFavoured) == 0) return {};
  return {std::string("niceness of -15 refused (") + std::strerror(errno) + "): samples may be late"};
}

std::vector<std::string> request_real_time(int priority) {
  const sched_param parameters{.sched_priority = priority};
  // The threads of DDS, web servers and logs must not inherit the priority, whenever they start.
  if (sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters) == 0) return {};
  const int error = errno;
  // The loop keeps its niceness. With this flag new threads do not inherit a negative one.
  const sched_param ordinary{};
  sched_setscheduler(0, SCHED_OTHER | SCHED_RESET_ON_FORK, &ordinary);
  return {std::string("real-time priority refused (") + std::strerror(error) + "): steps may be late"};
}

void become_ordinary() {
  const sched_param ordinary{};
  sched_setscheduler(0, SCHED_OTHER, &ordinary);
  if (getpriority(PRIO_PROCESS, 0) < 0) setpriority(PRIO_PROCESS, 0, 0);
  cpu_set_t all;
  CPU_ZERO(&all);
  for (int core = 0; core < std::min<int>(CPU_SETSIZE, static_cast<int>(sysconf(_SC_NPROCESSORS_CONF))); ++core)
    CPU_SET(core, &all);
  sched_setaffinity(0, sizeof(all), &all);
}

cpu_set_t parse_cores(const std::string& text) {
  cpu_set_t cores;
  CPU_ZERO(&cores);
  std::istringstream in(text);
  const auto core = [&in] {
    int number = -1;
    if (!std::isdigit(in.peek()) || !(in >> number) || number >= CPU_SETSIZE) number = -1;
    return number;
  };
  char separator = ',';
  while (separator == ',') {
    const int first = core();
    int last = first;
    separator = 0;
    if (in.get(separator) && separator == '-') {
      last = core();
      separator = 0;
      in.get(separator);
    }
    if (first < 0 || last < first || (in && separator != ','))
      throw std::invalid_argument("expected cores such as 2 or 0-1,3, got '" + text + "'");
    for (int each = first; each <= last; ++each) CPU_SET(each, &cores);
  }
  return cores;
}

}  // namespace softhand
