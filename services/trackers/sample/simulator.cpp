// simulate-tracker-sample PORT: sends a wrist that moves on a circle, 90 times a second, as the device would.
#include <arpa/inet.h>
#include <sys/socket.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <thread>

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const int out = socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(std::atoi(argv[1])));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  for (int i = 0;; ++i) {
    const double turn = 0.02 * i;
    const std::array<float, 7> packet{
        static_cast<float>(0.1 * std::cos(turn)), 1, static_cast<float>(0.1 * std::sin(turn)), 0, 0, 0, 1};
    sendto(out, packet.data(), sizeof packet, 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
    std::this_thread::sleep_for(std::chrono::microseconds(11'111));
  }
}
