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
#include <charconv>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "device/intake.hpp"
#include "runtime/clock.hpp"

namespace softhand {
namespace {

constexpr Nanoseconds kPatience = 1'000'000'000;
constexpr std::size_t kLargestAnswer = 1 << 20;  // bytes

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

bool waits_for(int number, short events, Nanoseconds end) {
  pollfd each{number, events, 0};
  return poll(&each, 1, static_cast<int>(std::max<Nanoseconds>(end - now(), 0) / 1'000'000)) == 1;
}

// A connection to the server, -1 if `out` is not good.
int connection_to(const std::string& what, const std::string& address, std::int64_t port, const std::string& advice,
                  DriverCheck& out) {
  const std::string at = what + " at TCP " + place(address, port);
  out = {true, at + " accepts connections"};
  const int number = socket_to(SOCK_STREAM, address, port);
  int error = number < 0 ? errno : ETIMEDOUT;
  socklen_t size = sizeof error;
  if (number >= 0 && waits_for(number, POLLOUT, now() + kPatience))
    getsockopt(number, SOL_SOCKET, SO_ERROR, &error, &size);
  if (error == 0) return number;
  if (number >= 0) close(number);
  out = {false, at + ": " + std::strerror(error), advice};
  return -1;
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

// 0 if this user may open the device.
int error_of_opening(const std::string& path) {
  const int number = open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
  if (number < 0) return errno;
  close(number);
  return 0;
}

// The number that a file has, -1 without it.
int number_in(const std::string& path, int base) {
  std::ifstream in(path);
  std::string text;
  int number = -1;
  if (in >> text) std::from_chars(text.data(), text.data() + text.size(), number, base);
  return number;
}

// "0403" of 0x403.
std::string id_text(int id) {
  std::array<char, 8> text{};
  std::snprintf(text.data(), text.size(), "%04x", static_cast<unsigned>(id) & 0xffff);
  return text.data();
}

// The name of the serial port that the kernel made for a USB device, such as ttyACM0. Empty if it made none.
std::string serial_port_of(const std::string& device) {
  std::error_code ignored;
  for (const auto& interface : std::filesystem::directory_iterator(device, ignored))
    for (const auto& port : std::filesystem::directory_iterator(interface.path() / "tty", ignored))
      return port.path().filename();
  return "";
}

}  // namespace

DriverCheck check_udp_listening(const std::string& address, std::int64_t port) {
  return listening("UDP", address, port, true);
}
DriverCheck check_tcp_listening(const std::string& address, std::int64_t port) {
  return listening("TCP", address, port, false);
}

DriverCheck check_tcp_server(const std::string& what, const std::string& address, std::int64_t port,
                             const std::string& advice) {
  std::string nothing;
  return check_tcp_server(what, address, port, advice, "", nothing, [](std::string_view) { return true; });
}

DriverCheck check_tcp_server(const std::string& what, const std::string& address, std::int64_t port,
                             const std::string& advice, std::string_view question, std::string& answer,
                             const std::function<bool(std::string_view)>& is_whole) {
  answer.clear();
  DriverCheck out;
  const int number = connection_to(what, address, port, advice, out);
  if (number < 0) return out;
  const Nanoseconds end = now() + kPatience;
  std::array<char, 4096> bytes;
  [[maybe_unused]] const ssize_t ignored = send(number, question.data(), question.size(), MSG_NOSIGNAL);
  while (!is_whole(answer) && answer.size() < kLargestAnswer && waits_for(number, POLLIN, end)) {
    const ssize_t size = read(number, bytes.data(), bytes.size());
    if (size <= 0) break;
    answer.append(bytes.data(), static_cast<std::size_t>(size));
  }
  close(number);
  return out;
}

DriverCheck check_udp_server(const std::string& what, const std::string& address, std::int64_t port,
                             std::string_view question, const std::string& advice, std::string& answer) {
  const std::string at = what + " at UDP " + place(address, port);
  const int number = socket_to(SOCK_DGRAM, address, port);
  if (number < 0) return {false, at + ": " + std::strerror(errno), advice};
  answer.assign(65536, '\0');
  const bool is_sent = send(number, question.data(), question.size(), MSG_NOSIGNAL) >= 0;
  const ssize_t size =
      is_sent && waits_for(number, POLLIN, now() + kPatience) ? recv(number, answer.data(), answer.size(), 0) : -1;
  const int error = errno;
  close(number);
  answer.resize(static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
  if (size < 0)
    return {false, at + " does not answer" + (error == ECONNREFUSED ? ": nothing listens there" : ""), advice};
  return {true, at + " answers"};
}

DriverCheck check_serial(const std::string& path) {
  switch (const int error = error_of_opening(path)) {
    case 0:
      return {true, path + " can be opened"};
    case EACCES:
      return {false, path + ": no permission",
              "`sudo usermod -aG dialout $USER`, then log in again; or a udev rule with TAG+=\"uaccess\""};
    default:
      return {false, path + ": " + std::strerror(error), "Connect the device. Serial ports now:" + serial_ports()};
  }
}

DriverChecks check_usb(int vendor, int product, const std::string& root) {
  DriverChecks out;
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(root + "/sys/bus/usb/devices", ignored)) {
    const std::string folder = entry.path();
    // Interfaces are in the same folder, without these files.
    const int vendor_here = number_in(folder + "/idVendor", 16), product_here = number_in(folder + "/idProduct", 16);
    if (vendor_here != vendor || (product >= 0 && product_here != product)) continue;
    const std::string name = id_text(vendor_here) + ":" + id_text(product_here);
    const std::string port = serial_port_of(folder);
    if (!port.empty()) {
      out.push_back(check_serial(root + "/dev/" + port));
      out.back().found = "USB device " + name + ": " + out.back().found;
      continue;
    }
    std::array<char, 16> node{};
    std::snprintf(node.data(), node.size(), "%03d/%03d", number_in(folder + "/busnum", 10) % 1000,
                  number_in(folder + "/devnum", 10) % 1000);
    const std::string path = root + "/dev/bus/usb/" + node.data();
    const int error = error_of_opening(path);
    out.push_back({error == 0, "USB device " + name + " can be opened"});
    if (error != 0)
      out.back() = {false, "USB device " + name + ": " + path + ": " + std::strerror(error),
                    "Write to /etc/udev/rules.d/70-softhand.rules: SUBSYSTEM==\"usb\", ATTR{idVendor}==\"" +
                        id_text(vendor_here) + "\", TAG+=\"uaccess\". Then connect the device again"};
  }
  return out;
}

DriverCheck check_library(const std::string& path, const std::vector<std::string>& functions,
                          const std::string& advice) {
  void* const library = dlopen(path.c_str(), RTLD_LAZY | RTLD_LOCAL);
  if (library == nullptr) return {false, dlerror(), advice};
  for (const std::string& function : functions)
    if (dlsym(library, function.c_str()) == nullptr) return {false, path + " lacks " + function, advice};
  return {true, path + " can be loaded"};
}

DriverCheck check_file(const std::string& what, const std::string& path) {
  if (access(path.c_str(), R_OK) == 0) return {true, what + " " + path + " can be read"};
  return {false, what + " " + path + ": " + std::strerror(errno), "Correct its path or its permissions"};
}

}  // namespace softhand
