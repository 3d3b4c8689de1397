// simulate-tactile-bhaptics PORT: the bHaptics Player. Prints the motors of the right glove when they change.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "tactile/bhaptics/simulated_player.hpp"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: simulate-tactile-bhaptics PORT\n");
    return 2;
  }
  const softhand::SimulatedPlayer player(std::atoi(argv[1]));
  std::array<int, softhand::kGloveMotors> shown{};
  for (;;) {
    const auto motors = player.motors();
    if (motors != shown) {
      for (const int motor : motors) std::printf("%d ", motor);
      std::printf("%%\n");
      std::fflush(stdout);
      shown = motors;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}
