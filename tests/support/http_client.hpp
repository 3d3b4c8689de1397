// A plain client of an HTTP server on this machine.
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdint>
#include <string>

namespace softhand::testing {

/// Asks for one page, or opens one WebSocket.
class HttpClient {
 public:
  HttpClient() : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    const timeval timeout{10, 0};
    setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
  }
  ~HttpClient() { close(socket_); }
  HttpClient(const HttpClient&) = delete;
  HttpClient& operator=(const HttpClient&) = delete;
  /// `address` is in network byte order.
  void connect(std::uint16_t port, in_addr_t address = htonl(INADDR_LOOPBACK)) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(port);
    to.sin_addr.s_addr = address;
    EXPECT_EQ(::connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to), 0);
  }
  void write(const std::string& text) { send(socket_, text.data(), text.size(), MSG_NOSIGNAL); }
  /// The answer's first line.
  std::string ask(const std::string& host) {
    write("GET / HTTP/1.1\r\nHost: " + host + "\r\nConnection: close\r\n\r\n");
    return line();
  }
  /// The answer's first line.
  std::string open_socket(const std::string& target, const std::string& host) {
    write("GET " + target + " HTTP/1.1\r\nHost: " + host +
          "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
          "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n");
    return line();
  }
  std::string line() {
    std::string line;
    for (char c = 0; recv(socket_, &c, 1, 0) == 1 && c != '\r';) line += c;
    return line;
  }
  /// True if the server has closed the connection without an answer.
  bool is_closed() {
    char c = 0;
    return recv(socket_, &c, 1, 0) == 0;
  }

 private:
  int socket_;
};

/// An address of this machine that is not a loopback address, or 0. A connection to it comes from it.
inline in_addr_t lan_address() {
  ifaddrs* all = nullptr;
  in_addr_t found = 0;
  if (getifaddrs(&all) != 0) return 0;
  for (const ifaddrs* each = all; each != nullptr; each = each->ifa_next) {
    if (each->ifa_addr != nullptr && each->ifa_addr->sa_family == AF_INET && (each->ifa_flags & IFF_LOOPBACK) == 0)
      found = reinterpret_cast<const sockaddr_in*>(each->ifa_addr)->sin_addr.s_addr;
  }
  freeifaddrs(all);
  return found;
}

}  // namespace softhand::testing
