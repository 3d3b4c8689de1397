// simulate-tactile-sample PORT: prints how the pins of the sample pad press whenever this changes, row by row.
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
  std::array<float, 27> forces{}, shown{};
  while (recv(in, forces.data(), sizeof forces, 0) >= 0) {
    if (forces == shown) continue;
    shown = forces;
    for (std::size_t pin = 0; pin < 9; ++pin)
      std::printf("%.3f%s", forces[3 * pin + 2], pin == 8 ? " N\n" : pin % 3 == 2 ? " | " : " ");
    std::fflush(stdout);
  }
}
