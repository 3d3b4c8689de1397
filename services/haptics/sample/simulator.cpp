// simulate-haptic-sample PORT: prints the forces of the sample glove whenever they change, as a glove would feel them.
#include <arpa/inet.h>
#include <sys/socket.h>

#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const int in = socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in here{};
  here.sin_family = AF_INET;
  here.sin_port = htons(static_cast<std::uint16_t>(std::atoi(argv[1])));
  here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (bind(in, reinterpret_cast<const sockaddr*>(&here), sizeof here) != 0) return 1;
  std::array<float, 5> forces{}, shown{};
  while (recv(in, forces.data(), sizeof forces, 0) >= 0) {
    if (forces == shown) continue;
    shown = forces;
    std::printf("%.3f %.3f %.3f %.3f %.3f N\n", forces[0], forces[1], forces[2], forces[3], forces[4]);
    std::fflush(stdout);
  }
}
