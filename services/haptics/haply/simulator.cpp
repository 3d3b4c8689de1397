// simulate-haptic-haply PORT EVENT_PORT [vector|values]: the service of an Inverse3 whose cursor goes up and down by
// 4 cm. Prints the forces when they change by more than 0.05 N.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>

#include "haptics/haply/simulated_inverse3.hpp"

int main(int argc, char** argv) {
  if (argc < 3 || argc > 4) {
    std::fprintf(stderr, "usage: simulate-haptic-haply PORT EVENT_PORT [vector|values]\n");
    return 2;
  }
  softhand::SimulatedInverse3 device(std::atoi(argv[1]), std::atoi(argv[2]), argc > 3 ? argv[3] : "vector");
  std::array<double, 3> printed{};
  for (double time = 0;; time += 1e-3) {
    device.move_to({0, -0.12, 0.15 + 0.02 * std::sin(2 * time)}, {0, 0, 0.04 * std::cos(2 * time)});
    const auto force = device.force();
    if (std::hypot(force[0] - printed[0], force[1] - printed[1], force[2] - printed[2]) > 0.05) {
      std::printf("force %.2f %.2f %.2f N\n", force[0], force[1], force[2]);
      std::fflush(stdout);
      printed = force;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}
