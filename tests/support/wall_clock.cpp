// Part of a test, or a library for LD_PRELOAD: a wall clock that is wrong.
#include "support/wall_clock.hpp"

#include <dlfcn.h>

#include <cstdlib>

namespace softhand::testing {

thread_local time_t wall_clock_shift = [] {
  const char* text = std::getenv("WALL_CLOCK_SHIFT");
  return text == nullptr ? time_t{0} : std::atol(text);
}();

}  // namespace softhand::testing

namespace {
template <typename Function>
Function next(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}
}  // namespace

extern "C" int clock_gettime(clockid_t clock, timespec* out) noexcept {
  static const auto real = next<int (*)(clockid_t, timespec*)>("clock_gettime");
  const int result = real(clock, out);
  if (clock == CLOCK_REALTIME && result == 0) out->tv_sec += softhand::testing::wall_clock_shift;
  return result;
}
extern "C" time_t time(time_t* out) noexcept {
  static const auto real = next<time_t (*)(time_t*)>("time");
  const time_t shifted = real(nullptr) + softhand::testing::wall_clock_shift;
  if (out != nullptr) *out = shifted;
  return shifted;
}
