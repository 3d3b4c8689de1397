// simulate-tracker-leap PORT [old|current|beta]: an Ultraleap service with two hands that close and open, at 110 Hz.
// Prints a line when it listens.
#include <chrono>
#include <cmath>
#include <cstdio>
#include <string>
#include <thread>

#include "device/simulated_service.hpp"
#include "runtime/clock.hpp"
#include "trackers/leap/simulated_leap.hpp"
#include "trackers/replay/generator.hpp"

int main(int argc, char** argv) {
  using namespace softhand;
  const std::string kind = argc > 2 ? argv[2] : "current";
  if (argc < 2 || (kind != "old" && kind != "current" && kind != "beta")) {
    std::fprintf(stderr, "usage: simulate-tracker-leap PORT [old|current|beta]\n");
    return 2;
  }
  const LeapService service = kind == "old"    ? LeapService::old
                              : kind == "beta" ? LeapService::beta
                                               : LeapService::current;
  SimulatedService server(std::stoi(argv[1]),
                          {[](const std::string&) { return std::string(kLeapServiceGreeting); }, nullptr, nullptr});
  std::printf("the service listens on TCP port %d\n", static_cast<int>(server.port()));
  std::fflush(stdout);
  const HandModel right = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json");
  GeneratorOptions options;
  options.motion = "fist";
  const std::array motions{make_motion(mirrored(right), options), make_motion(right, options)};
  const Nanoseconds start = now();
  for (;;) {
    const double time = std::fmod(static_cast<double>(now() - start) * 1e-9, motions[0]->duration());
    server.send(leap_frame_message((now() - start) / 1000,
                                   {{Side::left, above_camera(motions[0]->at(time), -0.15)},
                                    {Side::right, above_camera(motions[1]->at(time), 0.15)}},
                                   service));
    std::this_thread::sleep_for(std::chrono::microseconds(9'091));
  }
}
