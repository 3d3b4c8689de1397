// simulate-tactile-weart PORT: the WEART middleware with a TouchDIVER whose fingers close and open, at 50 Hz. Prints
// the effects when they change.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "tactile/weart/simulated_touchdiver.hpp"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: simulate-tactile-weart PORT\n");
    return 2;
  }
  softhand::SimulatedTouchDiver device(std::atoi(argv[1]));
  std::map<std::string, std::string> shown;
  for (double time = 0;; time += 0.02) {
    const int closure = static_cast<int>(std::lround(127 * (1 - std::cos(2 * time))));
    device.send(softhand::weart_tracking(closure, closure, closure));
    const auto effects = device.effects();
    if (effects != shown) {
      for (const auto& [key, values] : effects) std::printf("%s:%s ", key.c_str(), values.c_str());
      std::printf("\n");
      std::fflush(stdout);
      shown = effects;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}
