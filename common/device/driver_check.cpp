#include "device/driver_check.hpp"

#include <arpa/inet.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <stdexcept>

#include "device/intake.hpp"

namespace softhand {
namespace {

constexpr int kPatience = 1000;  // ms

std::string place(const std::string& address, std::int64_t port) { return address + ":" + std::to_string(port); }

DriverCheck listening(const std::string& what, const std::string& address, std::int64_t port, bool is_udp) {
  try {
    Intake intake(1);
    if (is_udp) {
      intake.listen_udp(address, port);
    } else {
      intake.listen_tcp(address, port, '\n');
    }
  } catch (const std::runtime_error& error) {
    return {false, error.what(),
            "If this driver does not run already, end the other program (`ss -tulpn` lists them) or choose another "
            "port"};
  }
  return {true, what + " port " + place(address, port) + " is free"};
}

// A socket towards a server of IPv4 or IPv6, -1 if the address is not numeric.
int socket_to(int type, const std::string& address, std::int64_t port) {
  sockaddr_in four{};
  sockaddr_in6 six{};
  four.sin_family = AF_INET;
  six.sin6_family = AF_INET6;
  four.sin_port = six.sin6_port = htons(static_cast<std::uint16_t>(port));
  const sockaddr* to = reinterpret_cast<const sockaddr*>(&four);
  socklen_t size = sizeof four;
  if (inet_pton(AF_INET, address.c_str(), &four.sin_addr) != 1) {
    if (inet_pton(AF_INET6, address.c_str(), &six.sin6_addr) != 1) {
      errno = EINVAL;
      return -1;
    }
    to = reinterpret_cast<const sockaddr*>(&six);
    size = sizeof six;
  }
  const int number = socket(to->sa_family, type | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (connect(number, to, size) == 0 || errno == EINPROGRESS) return number;
  const int error = errno;
  close(number);
  errno = error;
  return -1;
}

bool waits_for(int number, short events) {
  pollfd each{number, events, 0};
  return poll(&each, 1, kPatience) == 1;
}

std::string serial_ports() {
  std::string out;
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator("/dev", ignored)) {
    const std::string name = entry.path().filename();
    if (name.starts_with("ttyUSB") || name.starts_with("ttyACM") || name.starts_with("rfcomm"))
      out += " " + entry.path().string();
  }
  return out.empty() ? " none" : out;
}

}  // namespace

DriverCheck check_udp_listening(const std::string& address, std::int64_t port) {
  return listening("UDP", address, port, true);
}
DriverCheck check_tcp_listening(const std::string& address, std::int64_t port) {
  return listening("TCP", address, port, false);
}

DriverCheck check_tcp_server(const std::string& what, const std::string& address, std::int64_t port,
                             const std::string& advice, std::string* answer, std::size_t size) {
  const std::string at = what + " at TCP " + place(address, port);
  const int number = socket_to(SOCK_STREAM, address, port);
  if (number < 0) return {false, at + ": " + std::strerror(errno), advice};
  int error = ETIMEDOUT;
  socklen_t error_size = sizeof error;
  if (waits_for(number, POLLOUT)) getsockopt(number, SOL_SOCKET, SO_ERROR, &error, &error_size);
  if (error == 0 && answer != nullptr) {
    answer->clear();
    for (char c = 0; answer->size() < size && waits_for(number, POLLIN) && read(number, &c, 1) == 1;) *answer += c;
  }
  close(number);
  if (error != 0) return {false, at + ": " + std::strerror(error), advice};
  return {true, at + " accepts connections"};
}

DriverCheck check_udp_server(const std::string& what, const std::string& address, std::int64_t port,
                             std::string_view question, const std::string& advice, std::string& answer) {
  const std::string at = what + " at UDP " + place(address, port);
  const int number = socket_to(SOCK_DGRAM, address, port);
  if (number < 0) return {false, at + ": " + std::strerror(errno), advice};
  answer.assign(65536, '\0');
  const bool is_sent = send(number, question.data(), question.size(), MSG_NOSIGNAL) >= 0;
  const ssize_t size = is_sent && waits_for(number, POLLIN) ? recv(number, answer.data(), answer.size(), 0) : -1;
  const int error = errno;
  close(number);
  answer.resize(static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
  if (size < 0)
    return {false, at + " does not answer" + (error == ECONNREFUSED ? ": nothing listens there" : ""), advice};
  return {true, at + " answers"};
}

DriverCheck check_serial(const std::string& path) {
  const int number = open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (number >= 0) {
    close(number);
    return {true, path + " can be opened"};
  }
  if (errno == EACCES)
    return {false, path + ": no permission",
            "`sudo usermod -aG dialout $USER`, then log in again; or a udev rule with TAG+=\"uaccess\""};
  return {false, path + ": " + std::strerror(errno), "Connect the device. Serial ports now:" + serial_ports()};
}

DriverCheck check_library(const std::string& path, const std::vector<std::string>& functions,
                          const std::string& advice) {
  void* const library = dlopen(path.c_str(), RTLD_LAZY | RTLD_LOCAL);
  if (library == nullptr) return {false, dlerror(), advice};
  // It stays loaded: a library may have begun threads.
  for (const std::string& function : functions)
    if (dlsym(library, function.c_str()) == nullptr) return {false, path + " lacks " + function, advice};
  return {true, path + " can be loaded"};
}

DriverCheck check_file(const std::string& what, const std::string& path) {
  if (access(path.c_str(), R_OK) == 0) return {true, what + " " + path + " can be read"};
  return {false, what + " " + path + ": " + std::strerror(errno), "Correct its path or its permissions"};
}

}  // namespace softhand
