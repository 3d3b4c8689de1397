// bus_peer ROLE read|write TOPIC SECONDS: a program on Fast DDS in a secured domain. Prints `samples N` after it has
// read, or `readers N` after it has written. TOPIC is simulated_skeleton or bone_wrench.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <thread>

#include "bus/bus.hpp"

namespace {
using namespace softhand;

template <typename T>
void run(const bus::Participant& participant, const bus::Topic<T>& topic, bool reads, int seconds) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(seconds);
  const auto is_over = [&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return std::chrono::steady_clock::now() > end;
  };
  if (reads) {
    bus::Reader<T> reader(participant, topic);
    std::size_t samples = 0;
    while (!is_over()) samples += reader.take_all([](const T&) {});
    std::printf("samples %zu\n", samples);
  } else {
    bus::Writer<T> writer(participant, topic);
    T sample{};
    bool found = false;
    while (!is_over()) {
      found = found || writer.has_readers();
      writer.write(sample);
    }
    std::printf("readers %d\n", found ? 1 : 0);
  }
}
}  // namespace

int main(int argc, char** argv) {
  if (argc != 5) return 2;
  const std::string role = argv[1], topic = argv[3];
  try {
    const bus::Participant participant("bus_peer", bus::domain_from_environment(), {}, role);
    const bool reads = std::string(argv[2]) == "read";
    if (topic == "bone_wrench") {
      run(participant, bus::topics::bone_wrench, reads, std::atoi(argv[4]));
    } else {
      run(participant, bus::topics::simulated_skeleton, reads, std::atoi(argv[4]));
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bus_peer: %s\n", error.what());
    return 3;
  }
}
