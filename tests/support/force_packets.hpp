// The device's end of a sample driver: packets of forces over UDP.
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cstdint>

namespace softhand::testing {

template <std::size_t count>
class ForcePackets {
 public:
  using Forces = std::array<float, count>;

  ForcePackets() : socket_(socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0)) {
    sockaddr_in here{};
    here.sin_family = AF_INET;
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof here;
    EXPECT_EQ(bind(socket_, reinterpret_cast<const sockaddr*>(&here), size), 0);
    getsockname(socket_, reinterpret_cast<sockaddr*>(&here), &size);
    port_ = ntohs(here.sin_port);
  }
  ~ForcePackets() { close(socket_); }
  ForcePackets(const ForcePackets&) = delete;
  ForcePackets& operator=(const ForcePackets&) = delete;
  std::uint16_t port() const { return port_; }
  /// The newest forces, N.
  const Forces& forces() {
    Forces packet;
    while (recv(socket_, packet.data(), sizeof packet, 0) == sizeof packet) forces_ = packet;
    return forces_;
  }

 private:
  int socket_;
  std::uint16_t port_ = 0;
  Forces forces_{};
};

}  // namespace softhand::testing
