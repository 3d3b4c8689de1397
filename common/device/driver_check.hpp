// What a driver needs on this machine: ports, permissions, services, libraries. `softhand doctor` runs these checks.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace softhand {

struct DriverCheck {
  bool is_good = true;
  std::string found;     ///< one line
  std::string advice{};  ///< one line, if it is not good: what to do
};
using DriverChecks = std::vector<DriverCheck>;

/// A port to listen on. It is not good if another program holds it; this may be the driver itself.
DriverCheck check_udp_listening(const std::string& address, std::int64_t port);
DriverCheck check_tcp_listening(const std::string& address, std::int64_t port);

/// A server that accepts connections within 1 s. `what`: "the VRPN server". If `answer` is not null, it is filled with
/// the first `size` bytes that the server sends.
DriverCheck check_tcp_server(const std::string& what, const std::string& address, std::int64_t port,
                             const std::string& advice, std::string* answer = nullptr, std::size_t size = 0);
/// A server that answers a datagram within 1 s.
DriverCheck check_udp_server(const std::string& what, const std::string& address, std::int64_t port,
                             std::string_view question, const std::string& advice, std::string& answer);

/// A serial port that this user may open. The advice names the missing permission, or the ports that are there.
DriverCheck check_serial(const std::string& path);
/// A shared library that can be loaded, and that has these functions.
DriverCheck check_library(const std::string& path, const std::vector<std::string>& functions,
                          const std::string& advice);
/// A file that this user may read. `what`: "the certificate".
DriverCheck check_file(const std::string& what, const std::string& path);

}  // namespace softhand
