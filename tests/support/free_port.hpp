// A port that no program uses now, for servers that are programs of their own.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdint>

namespace softhand::testing {

inline sockaddr_in loopback(int port) {
  sockaddr_in out{};
  out.sin_family = AF_INET;
  out.sin_port = htons(static_cast<std::uint16_t>(port));
  out.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return out;
}
/// `type`: SOCK_DGRAM or SOCK_STREAM.
inline int free_port(int type) {
  const int number = socket(AF_INET, type, 0);
  sockaddr_in address = loopback(0);
  socklen_t size = sizeof address;
  bind(number, reinterpret_cast<const sockaddr*>(&address), size);
  getsockname(number, reinterpret_cast<sockaddr*>(&address), &size);
  close(number);
  return ntohs(address.sin_port);
}

}  // namespace softhand::testing
