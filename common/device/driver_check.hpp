// What a driver needs on this machine: ports, permissions, services, libraries. `softhand doctor` runs these checks.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <stdexcept>
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

/// A server that accepts connections within 1 s. `what`: "the VRPN server".
DriverCheck check_tcp_server(const std::string& what, const std::string& address, std::int64_t port,
                             const std::string& advice);
/// The same, and sends it `question`. `answer` is filled with what the server sends within 1 s, until
/// `is_whole(answer)`.
DriverCheck check_tcp_server(const std::string& what, const std::string& address, std::int64_t port,
                             const std::string& advice, std::string_view question, std::string& answer,
                             const std::function<bool(std::string_view)>& is_whole);
/// A server that answers a datagram within 1 s.
DriverCheck check_udp_server(const std::string& what, const std::string& address, std::int64_t port,
                             std::string_view question, const std::string& advice, std::string& answer);

/// A serial port that this user may open. The advice names the missing permission, or the ports that are there.
DriverCheck check_serial(const std::string& path);
/// The connected USB devices with these ids, each with a check whether this user may open it: its serial port if it has
/// one, otherwise the USB device itself. `product`: -1 = any. `root`: the folder with /sys and /dev.
DriverChecks check_usb(int vendor, int product = -1, const std::string& root = "");
/// A shared library that can be loaded, and that has these functions. It stays loaded, because it may have begun
/// threads.
DriverCheck check_library(const std::string& path, const std::vector<std::string>& functions,
                          const std::string& advice);
/// A library as its driver loads it: `Library` has a constructor that throws std::runtime_error if a function is
/// missing. Adds a check to `out`. Returns nothing if it is not good.
template <typename Library>
std::optional<Library> check_library(const std::string& path, const std::string& advice, DriverChecks& out) {
  out.push_back(check_library(path, {}, advice));
  if (!out.back().is_good) return std::nullopt;
  try {
    return std::optional<Library>(std::in_place, path);
  } catch (const std::runtime_error& error) {
    out.back() = {false, error.what(), advice};
    return std::nullopt;
  }
}
/// A file that this user may read. `what`: "the certificate".
DriverCheck check_file(const std::string& what, const std::string& path);

}  // namespace softhand
