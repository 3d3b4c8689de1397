// A DDS domain for each test program, so that tests may run in parallel.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <stdexcept>
#include <string>

namespace softhand::testing {

/// The domain of this process, from 51 to 99. A socket that listens on port 20000 + domain of the loopback interface
/// reserves it until the process ends. Tests of the viewer do the same (tests/viewer/harness.mjs). Throws
/// std::runtime_error if all are taken. Users have the domains below. The ports of domains above 100 are among those
/// that Linux gives to sockets that ask for any port. A socket of another test may then have the port through which
/// processes find each other.
inline int own_domain() {
  static const int domain = [] {
    for (int i = 0; i < 49; ++i) {
      const int candidate = 51 + (getpid() + i) % 49;
      const int reservation = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
      sockaddr_in address{};
      address.sin_family = AF_INET;
      address.sin_port = htons(static_cast<std::uint16_t>(20000 + candidate));
      address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
      if (bind(reservation, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 &&
          listen(reservation, 1) == 0)
        return candidate;
      close(reservation);
    }
    throw std::runtime_error("all domains from 51 to 99 are reserved by tests");
  }();
  return domain;
}

/// Sets SOFTHAND_DOMAIN of this process, and so of its children.
inline void use_own_domain() { setenv("SOFTHAND_DOMAIN", std::to_string(own_domain()).c_str(), 1); }

}  // namespace softhand::testing
