// A library for LD_PRELOAD: the wall clock of a process is wrong by WALL_CLOCK_SHIFT seconds. Its monotonic clock
// stays.
#include <dlfcn.h>
#include <time.h>

#include <cstdlib>

namespace {
time_t shift() {
  static const char* text = std::getenv("WALL_CLOCK_SHIFT");
  return text == nullptr ? 0 : std::atol(text);
}
template <typename Function>
Function next(const char* name) {
  return reinterpret_cast<Function>(dlsym(RTLD_NEXT, name));
}
}  // namespace

extern "C" int clock_gettime(clockid_t clock, timespec* out) noexcept {
  static const auto real = next<int (*)(clockid_t, timespec*)>("clock_gettime");
  const int result = real(clock, out);
  if (clock == CLOCK_REALTIME && result == 0) out->tv_sec += shift();
  return result;
}
extern "C" time_t time(time_t* out) noexcept {
  static const auto real = next<time_t (*)(time_t*)>("time");
  const time_t shifted = real(nullptr) + shift();
  if (out != nullptr) *out = shifted;
  return shifted;
}
