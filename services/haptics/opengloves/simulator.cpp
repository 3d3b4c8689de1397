// simulate-haptic-opengloves tcp PORT | serial PATH: a glove whose fingers close and open, at 100 Hz. With TCP it
// connects to 127.0.0.1, and ends when the connection fails. With serial it makes PATH a link to a pseudo terminal.
// Like the firmware it waits up to 1 s for a line after each of its own. Prints the forces when they change.
#include <arpa/inet.h>
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "haptics/opengloves/simulated_glove.hpp"
#include "runtime/clock.hpp"

namespace {

int connect_to(int port) {
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(port));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const int number = socket(AF_INET, SOCK_STREAM, 0);
  if (connect(number, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0) return number;
  std::perror("simulate-haptic-opengloves: connect");
  std::exit(1);
}

int make_terminal(const std::string& path) {
  const int number = posix_openpt(O_RDWR | O_NOCTTY);
  termios settings{};
  if (number < 0 || grantpt(number) != 0 || unlockpt(number) != 0 || tcgetattr(number, &settings) != 0) std::exit(1);
  cfmakeraw(&settings);
  tcsetattr(number, TCSANOW, &settings);
  unlink(path.c_str());
  if (symlink(ptsname(number), path.c_str()) != 0) {
    std::perror("simulate-haptic-opengloves: symlink");
    std::exit(1);
  }
  return number;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace softhand;
  const std::string transport = argc > 2 ? argv[1] : "";
  if (transport != "tcp" && transport != "serial") {
    std::fprintf(stderr, "usage: simulate-haptic-opengloves tcp PORT | serial PATH\n");
    return 2;
  }
  const int glove = transport == "tcp" ? connect_to(std::atoi(argv[2])) : make_terminal(argv[2]);
  std::array<int, 5> forces{}, printed{-1};
  std::string received;
  const Nanoseconds start = now();
  for (;;) {
    const double time = static_cast<double>(now() - start) * 1e-9;
    std::array<int, 5> curls, splays;
    curls.fill(static_cast<int>(std::lround(2000 * (1 - std::cos(2 * time)))));
    splays.fill(2047);
    const std::string line = glove_line(curls, &splays);
    // A terminal without a reader fails, as a cable without a computer does.
    if (write(glove, line.data(), line.size()) < 0 && transport == "tcp") return 1;
    pollfd answer{glove, POLLIN, 0};
    if (poll(&answer, 1, 1000) > 0) {
      char bytes[256];
      const ssize_t size = read(glove, bytes, sizeof bytes);
      if (size <= 0 && transport == "tcp") return 1;
      if (size > 0) received.append(bytes, static_cast<std::size_t>(size));
    }
    for (std::size_t end; (end = received.find('\n')) != std::string::npos; received.erase(0, end + 1))
      read_forces(received.substr(0, end), forces);
    if (forces != printed) {
      std::printf("forces %d %d %d %d %d\n", forces[0], forces[1], forces[2], forces[3], forces[4]);
      std::fflush(stdout);
      printed = forces;
    }
    usleep(10'000);
  }
}
