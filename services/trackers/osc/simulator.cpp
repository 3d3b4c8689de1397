// simulate-tracker-osc PORT [bundle|plain]: a VMC performer with a head and two hands that close and open, 60 times a
// second, to 127.0.0.1. `bundle` sends each frame as one bundle instead of single messages. `plain` sends plain hands.
#include <arpa/inet.h>
#include <sys/socket.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <string>
#include <thread>

#include "runtime/clock.hpp"
#include "trackers/osc/simulated_performer.hpp"
#include "trackers/replay/generator.hpp"

int main(int argc, char** argv) {
  using namespace softhand;
  if (argc < 2) {
    std::fprintf(stderr, "usage: simulate-tracker-osc PORT [bundle|plain]\n");
    return 2;
  }
  const std::string mode = argc > 2 ? argv[2] : "";
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(std::stoi(argv[1])));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const int out = socket(AF_INET, SOCK_DGRAM, 0);
  const HandModel right = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json");
  GeneratorOptions options;
  options.motion = "fist";
  const std::array motions{make_motion(mirrored(right), options), make_motion(right, options)};
  const Nanoseconds start = now();
  for (;;) {
    const double time = static_cast<double>(now() - start) * 1e-9;
    const std::array hands{motions[0]->at(std::fmod(time, motions[0]->duration())),
                           motions[1]->at(std::fmod(time, motions[1]->duration()))};
    std::vector<std::string> frame;
    if (mode == "plain") {
      const std::vector<double> curls(5, 0.5 - 0.5 * std::cos(2 * time));
      for (const Side side : {Side::left, Side::right}) {
        const Pose wrist = hands[static_cast<std::size_t>(side)][slot_of(Joint::wrist)];
        for (std::string& packet : plain_hand(side, wrist, curls)) frame.push_back(std::move(packet));
      }
    } else {
      frame = performer_frame(time, Pose{}, {Vector3(0.05 * std::sin(time), 1.6, 0), Quaternion::Identity()}, hands);
    }
    if (mode == "bundle") frame = {osc_bundle(frame)};
    for (const std::string& packet : frame)
      sendto(out, packet.data(), packet.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
    std::this_thread::sleep_for(std::chrono::microseconds(16'667));
  }
}
