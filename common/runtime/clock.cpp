#include "runtime/clock.hpp"

#include <sys/timex.h>

#include <ctime>
#include <fstream>
#include <random>
#include <sstream>
#include <string>

namespace softhand {

Nanoseconds now() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<Nanoseconds>(t.tv_sec) * 1'000'000'000 + t.tv_nsec;
}

std::uint32_t clock_id() {
  std::uint32_t hash = 2166136261u;  // FNV-1a
  const auto add = [&hash](const std::string& text) {
    for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 16777619u;
  };
  std::string line;
  std::getline(std::ifstream("/proc/sys/kernel/random/boot_id"), line);
  add(line);
  // A container may have a time namespace. Its clock is another one, although the kernel is the same.
  std::ifstream offsets("/proc/self/timens_offsets");
  while (std::getline(offsets, line)) {
    std::istringstream in(line);
    std::string clock;
    Nanoseconds seconds = 0, rest = 0;
    if (in >> clock >> seconds >> rest && clock == "monotonic" && (seconds != 0 || rest != 0)) add(line);
  }
  return hash == 0 ? 1 : hash;
}

WallClock wall_clock() {
  WallClock clock;
  timespec wall{};
  // The wall clock is read between two readings of the other, so an interruption shows.
  const Nanoseconds before = now();
  clock_gettime(CLOCK_REALTIME, &wall);
  const Nanoseconds after = now();
  clock.offset = static_cast<Nanoseconds>(wall.tv_sec) * 1'000'000'000 + wall.tv_nsec - (before + after) / 2;
  timex state{};
  if (adjtimex(&state) == TIME_ERROR || (state.status & STA_UNSYNC) != 0) return clock;
  clock.uncertainty = 1e-6 * static_cast<double>(state.esterror) + 0.5e-9 * static_cast<double>(after - before);
  return clock;
}

std::uint64_t make_epoch() {
  std::random_device device;
  const std::uint64_t high = device();
  const std::uint64_t epoch = high << 32 | device();
  return epoch == 0 ? 1 : epoch;
}

}  // namespace softhand
