#include "runtime/clock.hpp"

#include <ctime>
#include <fstream>
#include <random>
#include <string>

namespace softhand {

Nanoseconds now() {
  timespec t{};
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<Nanoseconds>(t.tv_sec) * 1'000'000'000 + t.tv_nsec;
}

std::uint32_t clock_id() {
  std::ifstream in("/proc/sys/kernel/random/boot_id");
  std::string boot;
  std::getline(in, boot);
  std::uint32_t hash = 2166136261u;  // FNV-1a
  for (const char c : boot) hash = (hash ^ static_cast<unsigned char>(c)) * 16777619u;
  return hash == 0 ? 1 : hash;
}

std::uint64_t make_epoch() {
  std::random_device device;
  const std::uint64_t high = device();
  const std::uint64_t epoch = high << 32 | device();
  return epoch == 0 ? 1 : epoch;
}

}  // namespace softhand
