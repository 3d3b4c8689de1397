// simulate-tracker-streamer udp|tcp PORT [times]: the app Hand Tracking Streamer with a moving head and two hands that
// close and open, to 127.0.0.1. `times` adds the app's debug header. Like the app, it ends when a TCP connection fails,
// and it has one connection for each hand and for the head.
#include <arpa/inet.h>
#include <sys/socket.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <string>
#include <thread>

#include "runtime/clock.hpp"
#include "trackers/replay/generator.hpp"
#include "trackers/streamer/simulated_streamer.hpp"

int main(int argc, char** argv) {
  using namespace softhand;
  const std::string transport = argc > 2 ? argv[1] : "";
  const bool is_tcp = transport == "tcp";
  if (!is_tcp && transport != "udp") {
    std::fprintf(stderr, "usage: simulate-tracker-streamer udp|tcp PORT [times]\n");
    return 2;
  }
  const bool has_times = argc > 3 && std::string(argv[3]) == "times";
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(std::stoi(argv[2])));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::array<int, 3> sockets;
  for (int& socket_number : sockets) {
    socket_number = socket(AF_INET, is_tcp ? SOCK_STREAM : SOCK_DGRAM, 0);
    if (connect(socket_number, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0) {
      std::perror("simulate-tracker-streamer: connect");
      return 1;
    }
  }

  const HandModel right = load_hand(std::string(SOFTHAND_SOURCE_DIR) + "/config/hands/right_400.hand.json");
  const std::array<HandModel, 2> hands{mirrored(right), right};
  GeneratorOptions options;
  options.motion = "fist";
  const std::array motions{make_motion(hands[0], options), make_motion(hands[1], options)};
  const Nanoseconds start = now();
  for (std::uint64_t frame = 1;; ++frame) {
    const double time = static_cast<double>(now() - start) * 1e-9;
    std::optional<StreamerHeader> header;
    if (has_times) header = {frame, static_cast<std::uint64_t>(now() - start) + 1};
    for (std::size_t i = 0; i < sockets.size(); ++i) {
      std::string text =
          i < 2 ? streamer_hand(hands[i].side, motions[i]->at(std::fmod(time, motions[i]->duration())), header)
                : streamer_head({Vector3(0.05 * std::sin(time), 1.6, 0), Quaternion::Identity()}, header);
      if (is_tcp) text += "\n";
      if (send(sockets[i], text.data(), text.size(), MSG_NOSIGNAL) < 0 && is_tcp) return 1;
    }
    std::this_thread::sleep_for(std::chrono::microseconds(13'889));  // 72 Hz
  }
}
