#include "device/intake.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <functional>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

#include "device/health.hpp"
#include "device/stream_socket.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "runtime/scheduling.hpp"

namespace softhand {
namespace {

constexpr std::size_t kMostConnections = 16;
constexpr int kMostReads = 64;  // of one sender in a turn
constexpr std::size_t kOutgoing = 64;
constexpr Nanoseconds kLastPacketTime = 50'000'000;
constexpr Nanoseconds kAcceptPause = 100'000'000;  // after a connection that could not be accepted

/// Owns a file descriptor.
class File {
 public:
  explicit File(int number = -1) : number_(number) {}
  File(File&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  File& operator=(File&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~File() {
    if (number_ >= 0) close(number_);
  }
  int number() const { return number_; }
  bool open() const { return number_ >= 0; }

 private:
  int number_;
};

std::runtime_error cannot(const std::string& what, const std::string& address, std::int64_t port,
                          const std::string& why) {
  return std::runtime_error("cannot " + what + " " + address + ":" + std::to_string(port) + ": " + why);
}

/// A numeric address and a port.
struct Address {
  sockaddr_storage bytes{};
  socklen_t size = 0;

  Address() = default;
  /// `what` is for the error.
  Address(const std::string& address, std::int64_t port, const std::string& what) {
    auto& four = reinterpret_cast<sockaddr_in&>(bytes);
    auto& six = reinterpret_cast<sockaddr_in6&>(bytes);
    const auto wire_port = htons(static_cast<std::uint16_t>(port));
    if (inet_pton(AF_INET, address.c_str(), &four.sin_addr) == 1) {
      four.sin_family = AF_INET;
      four.sin_port = wire_port;
      size = sizeof four;
    } else if (inet_pton(AF_INET6, address.c_str(), &six.sin6_addr) == 1) {
      six.sin6_family = AF_INET6;
      six.sin6_port = wire_port;
      size = sizeof six;
    } else {
      throw cannot(what, address, port, "expected a numeric address such as 127.0.0.1 or 0.0.0.0");
    }
  }
  sockaddr* pointer() { return reinterpret_cast<sockaddr*>(&bytes); }
  const sockaddr* pointer() const { return reinterpret_cast<const sockaddr*>(&bytes); }
  bool is_host_of(const Address& other) const {
    if (bytes.ss_family != other.bytes.ss_family) return false;
    if (bytes.ss_family == AF_INET)
      return reinterpret_cast<const sockaddr_in&>(bytes).sin_addr.s_addr ==
             reinterpret_cast<const sockaddr_in&>(other.bytes).sin_addr.s_addr;
    return std::memcmp(&reinterpret_cast<const sockaddr_in6&>(bytes).sin6_addr,
                       &reinterpret_cast<const sockaddr_in6&>(other.bytes).sin6_addr, sizeof(in6_addr)) == 0;
  }
  std::uint16_t port() const {
    return ntohs(bytes.ss_family == AF_INET6 ? reinterpret_cast<const sockaddr_in6&>(bytes).sin6_port
                                             : reinterpret_cast<const sockaddr_in&>(bytes).sin_port);
  }
};

File open_socket(const Address& of, int type) {
  return File(socket(of.bytes.ss_family, type | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
}

struct Bound {
  File socket;
  std::uint16_t port = 0;
};

Bound bind_socket(int type, const std::string& address, std::int64_t port) {
  const std::string what = std::string("listen on ") + (type == SOCK_DGRAM ? "UDP" : "TCP");
  Address to(address, port, what);
  Bound out{open_socket(to, type), 0};
  const int yes = 1;
  // A TCP port that was in use may be taken again at once. A UDP port with this option could be shared by mistake.
  if (type == SOCK_STREAM) setsockopt(out.socket.number(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  if (!out.socket.open() || bind(out.socket.number(), to.pointer(), to.size) != 0 ||
      (type == SOCK_STREAM && listen(out.socket.number(), 16) != 0))
    throw cannot(what, address, port, std::strerror(errno));
  getsockname(out.socket.number(), to.pointer(), &to.size);
  out.port = to.port();
  return out;
}

File join_group(const std::string& group, std::int64_t port, const std::string& network) {
  const std::string what = "join the multicast group";
  ip_mreqn membership{};
  if (inet_pton(AF_INET, group.c_str(), &membership.imr_multiaddr) != 1 ||
      inet_pton(AF_INET, network.c_str(), &membership.imr_address) != 1)
    throw cannot(what, group, port, "expected a numeric address of IPv4, and one of a network of this machine");
  const Address to(group, port, what);
  File out = open_socket(to, SOCK_DGRAM);
  const int yes = 1;
  if (!out.open() || setsockopt(out.number(), SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) != 0 ||
      bind(out.number(), to.pointer(), to.size) != 0 ||
      setsockopt(out.number(), IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) != 0)
    throw cannot(what, group, port, std::strerror(errno));
  return out;
}

speed_t termios_speed(std::int64_t baud) {
  constexpr std::array<std::pair<std::int64_t, speed_t>, 9> speeds{{{9600, B9600},
                                                                    {19200, B19200},
                                                                    {38400, B38400},
                                                                    {57600, B57600},
                                                                    {115200, B115200},
                                                                    {230400, B230400},
                                                                    {460800, B460800},
                                                                    {921600, B921600},
                                                                    {1000000, B1000000}}};
  for (const auto& [rate, speed] : speeds)
    if (rate == baud) return speed;
  throw std::invalid_argument("baud rate " + std::to_string(baud) + ": expected 9600 to 1000000, as in termios");
}

File open_port(const std::string& path, speed_t speed) {
  File file(open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  termios settings{};
  if (!file.open() || tcgetattr(file.number(), &settings) != 0) return File();
  cfmakeraw(&settings);
  settings.c_cflag = (settings.c_cflag & ~static_cast<tcflag_t>(CSTOPB | CRTSCTS)) | CLOCAL | CREAD;
  cfsetspeed(&settings, speed);
  if (tcsetattr(file.number(), TCSANOW, &settings) != 0) return File();
  tcflush(file.number(), TCIFLUSH);
  return file;
}

// A connection that has begun. A server that does not answer fails it after 7 s.
File begin_connection(const Address& to) {
  File out = open_socket(to, SOCK_STREAM);
  const int attempts = 2;
  setsockopt(out.number(), IPPROTO_TCP, TCP_SYNCNT, &attempts, sizeof attempts);
  if (!out.open() || (connect(out.number(), to.pointer(), to.size) != 0 && errno != EINPROGRESS)) return File();
  return out;
}

// A socket whose peer is gone must not raise SIGPIPE.
ssize_t write_to(int file, std::string_view bytes) {
  const ssize_t size = send(file, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  return size < 0 && errno == ENOTSOCK ? write(file, bytes.data(), bytes.size()) : size;
}

}  // namespace

class Intake::Impl {
 public:
  Impl(std::size_t largest, std::size_t slots)
      : largest_(largest),
        queue_(largest, slots),
        outgoing_(largest, kOutgoing),
        buffer_(largest + 1, '\0'),
        wake_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    if (!wake_.open()) throw std::runtime_error(std::string("eventfd: ") + std::strerror(errno));
  }
  ~Impl() {
    stop_ = true;
    wake();
    if (thread_.joinable()) thread_.join();
  }

  std::uint16_t listen_udp(const std::string& address, std::int64_t port) {
    Bound bound = bind_socket(SOCK_DGRAM, address, port);
    datagrams_.push_back({std::move(bound.socket), {}, false});
    return bound.port;
  }
  void connect_udp(const std::string& address, std::int64_t port) {
    const Address server(address, port, "send to UDP");
    datagrams_.push_back({open_socket(server, SOCK_DGRAM), server, true});
  }
  void join_udp(const std::string& address, const std::string& group, std::int64_t port, const std::string& network) {
    datagrams_.push_back({join_group(group, port, network), Address(address, port, "receive from UDP"), false});
  }
  std::uint16_t listen_tcp(const std::string& address, std::int64_t port, Framing framing) {
    Bound bound = bind_socket(SOCK_STREAM, address, port);
    listeners_.push_back({std::move(bound.socket), framing});
    return bound.port;
  }
  void connect_tcp(const std::string& address, std::int64_t port, Framing framing, const std::string& greeting) {
    const Address server(address, port, "connect to TCP");
    ports_.push_back({[server] { return begin_connection(server); }, true, framing, greeting, {}, 0, 0});
  }
  void open_serial(const std::string& path, std::int64_t baud, Framing framing) {
    const speed_t speed = termios_speed(baud);
    ports_.push_back({[path, speed] { return open_port(path, speed); }, false, framing, "", {}, 0, 0});
  }
  void set_release(std::string bytes) { release_packet_ = std::move(bytes); }
  void release() {
    is_released_ = true;
    wake();
  }
  void start() {
    has_datagrams_ = !datagrams_.empty();
    thread_ = std::thread([this] {
      become_ordinary();
      run();
    });
  }

  void send(std::uint64_t connection, std::string_view bytes) {
    outgoing_.push({bytes, 0, connection, false});
    wake();
  }
  ArrivalQueue& queue() { return queue_; }
  bool connected() const { return has_datagrams_ || connections_ > 0; }
  bool has_streams() const { return !listeners_.empty() || !ports_.empty(); }
  Counters counters() const {
    const std::uint64_t opened = opened_;
    return {connections_,         opened > 0 ? opened - first_ : 0,    refused_size_, refused_cut_,
            queue_.passed_over(), superseded_ + outgoing_.superseded()};
  }

 private:
  struct Datagrams {
    File socket;
    Address server;  // of size 0: packets of any sender are taken
    bool sends;      // to the server
  };
  struct Listener {
    File socket;
    Framing framing;
  };
  // What is opened again after a failure.
  struct Port {
    std::function<File()> open;
    bool is_socket;  // it opens when the server answers
    Framing framing;
    std::string greeting;
    Backoff backoff;
    Nanoseconds next_attempt;
    std::uint64_t connection;  // 0 = closed
  };
  struct Stream {
    File file;
    PacketSplitter splitter;
    std::uint64_t id;
    bool is_connecting;
    bool is_closed = false;
    // Bytes to the device: of the packet that has begun, and the newest packet that waits behind it.
    std::string sending{}, next{};
  };

  void wake() const {
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t ignored = write(wake_.number(), &one, sizeof one);
  }

  void run() {
    std::vector<pollfd> files;
    for (;;) {
      open_ports();
      files.clear();
      files.push_back({wake_.number(), POLLIN, 0});
      for (const Datagrams& each : datagrams_) files.push_back({each.socket.number(), POLLIN, 0});
      // poll passes over negative numbers.
      const bool accepts = now() >= accept_after_;
      for (const Listener& listener : listeners_) files.push_back({accepts ? listener.socket.number() : -1, POLLIN, 0});
      for (const Stream& stream : streams_) {
        const bool writes = stream.is_connecting || !stream.sending.empty();
        files.push_back({stream.file.number(), static_cast<short>(writes ? POLLIN | POLLOUT : POLLIN), 0});
      }
      if (poll(files.data(), files.size(), milliseconds_to_next_attempt(accepts)) < 0 && errno != EINTR) return;
      // First of all the commands: a force that ends must not wait.
      std::uint64_t wakes = 0;
      [[maybe_unused]] const ssize_t ignored = read(wake_.number(), &wakes, sizeof wakes);
      // A packet that was pushed before `stop_` was set is taken below.
      const bool ends = stop_;
      outgoing_.take([this](const Arrival& packet) { send_now(packet.connection, packet.bytes); });
      if (is_released_.exchange(false)) send_now(0, release_packet_);
      for (Stream& stream : streams_) write_bytes(stream);
      if (ends) return write_last();
      std::size_t at = 1;
      for (const Datagrams& each : datagrams_)
        if (files[at++].revents != 0) receive_datagrams(each);
      const std::size_t first_stream = at + listeners_.size();
      for (std::size_t i = 0; i < streams_.size(); ++i)
        if (files[first_stream + i].revents != 0) receive_bytes(streams_[i]);
      for (const Listener& listener : listeners_)
        if (files[at++].revents != 0) accept_one(listener);
      close_streams();
    }
  }

  void send_now(std::uint64_t connection, std::string_view bytes) {
    for (Stream& stream : streams_)
      if (connection == 0 || connection == stream.id) enqueue(stream, bytes);
    for (const Datagrams& each : datagrams_) {
      if (connection != 0 || !each.sends) continue;
      sendto(each.socket.number(), bytes.data(), bytes.size(), MSG_DONTWAIT, each.server.pointer(), each.server.size);
    }
  }
  void enqueue(Stream& stream, std::string_view bytes) {
    if (stream.is_connecting) return;
    if (!stream.next.empty()) ++superseded_;
    (stream.sending.empty() ? stream.sending : stream.next) = bytes;
  }
  void write_bytes(Stream& stream) {
    while (!stream.sending.empty() && !stream.is_closed) {
      const ssize_t size = write_to(stream.file.number(), stream.sending);
      if (size < 0 && errno == EINTR) continue;
      if (size < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return;
      if (size <= 0) {
        stream.is_closed = true;
        return;
      }
      stream.sending.erase(0, static_cast<std::size_t>(size));
      if (stream.sending.empty()) std::swap(stream.sending, stream.next);
    }
  }
  // Waits until all devices have taken their last packet.
  void write_last() {
    const Nanoseconds end = now() + kLastPacketTime;
    const auto waits = [](const Stream& stream) { return !stream.sending.empty() && !stream.is_closed; };
    while (now() < end && std::any_of(streams_.begin(), streams_.end(), waits)) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      for (Stream& stream : streams_) write_bytes(stream);
    }
  }

  void receive_datagrams(const Datagrams& from) {
    for (int i = 0; i < kMostReads; ++i) {
      Address sender;
      sender.size = sizeof sender.bytes;
      // The buffer has one spare byte. A datagram that fills it is larger than allowed.
      const ssize_t size =
          recvfrom(from.socket.number(), buffer_.data(), buffer_.size(), MSG_DONTWAIT, sender.pointer(), &sender.size);
      // A server that is not there answers ECONNREFUSED once.
      if (size < 0 && errno == ECONNREFUSED) continue;
      if (size < 0) return;
      if (from.server.size != 0 && !sender.is_host_of(from.server)) continue;
      if (static_cast<std::size_t>(size) > largest_) {
        ++refused_size_;
      } else {
        queue_.push({{buffer_.data(), static_cast<std::size_t>(size)}, now(), 0, false});
      }
    }
  }

  void accept_one(const Listener& listener) {
    File socket(accept4(listener.socket.number(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
    if (!socket.open()) {
      // For example no file descriptor is free. The connection still waits, so another attempt now would fail too.
      accept_after_ = now() + kAcceptPause;
      return;
    }
    watch_peer(socket.number());
    if (streams_.size() >= kMostConnections) streams_.front().is_closed = true;
    established(add_stream(std::move(socket), listener.framing, false));
  }

  Stream& add_stream(File file, Framing framing, bool is_connecting) {
    streams_.push_back({std::move(file), PacketSplitter(framing, largest_), ++last_id_, is_connecting});
    for (std::string* text : {&streams_.back().sending, &streams_.back().next}) text->reserve(largest_);
    return streams_.back();
  }
  void established(Stream& stream) {
    stream.is_connecting = false;
    ++opened_;
    // Connections that are opened while another one exists are no reconnects: two hands have two connections.
    if (!closed_any_) first_ = opened_.load();
    ++connections_;
    for (Port& port : ports_) {
      if (port.connection != stream.id) continue;
      port.backoff.reset();
      if (!port.greeting.empty()) enqueue(stream, port.greeting);
    }
  }
  // Returns true if bytes may be received.
  bool finish_connecting(Stream& stream) {
    int error = 0;
    socklen_t size = sizeof error;
    getsockopt(stream.file.number(), SOL_SOCKET, SO_ERROR, &error, &size);
    if (error != 0) {
      stream.is_closed = true;
      return false;
    }
    watch_peer(stream.file.number());
    established(stream);
    return true;
  }

  void receive_bytes(Stream& stream) {
    if (stream.is_connecting && !finish_connecting(stream)) return;
    for (int i = 0; i < kMostReads; ++i) {
      const ssize_t size = read(stream.file.number(), buffer_.data(), buffer_.size());
      if (size < 0 && errno == EINTR) continue;
      if (size < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return;
      if (size <= 0) {
        stream.is_closed = true;
        return;
      }
      const Nanoseconds time = now();
      const bool goes_on = stream.splitter.take(
          {buffer_.data(), static_cast<std::size_t>(size)},
          [&](std::string_view packet) {
            queue_.push({packet, time, stream.id, false});
          },
          [this] { ++refused_size_; });
      if (goes_on) continue;
      stream.is_closed = true;
      return;
    }
  }

  void close_streams() {
    for (const Stream& stream : streams_) {
      if (!stream.is_closed) continue;
      if (!stream.is_connecting) {
        closed_any_ = true;
        --connections_;
      }
      if (stream.splitter.is_within_packet()) ++refused_cut_;
      for (Port& port : ports_) {
        if (port.connection != stream.id) continue;
        port.connection = 0;
        port.next_attempt = now() + port.backoff.next();
      }
    }
    std::erase_if(streams_, [](const Stream& stream) { return stream.is_closed; });
  }

  void open_ports() {
    for (Port& port : ports_) {
      if (port.connection != 0 || now() < port.next_attempt) continue;
      File file = port.open();
      if (file.open()) {
        Stream& stream = add_stream(std::move(file), port.framing, port.is_socket);
        port.connection = stream.id;
        if (!port.is_socket) established(stream);
      } else {
        port.next_attempt = now() + port.backoff.next();
      }
    }
  }

  int milliseconds_to_next_attempt(bool accepts) const {
    Nanoseconds wait = -1;
    const auto attempt_at = [&wait](Nanoseconds time) {
      const Nanoseconds left = std::max<Nanoseconds>(0, time - now());
      wait = wait < 0 ? left : std::min(wait, left);
    };
    if (!accepts) attempt_at(accept_after_);
    for (const Port& port : ports_)
      if (port.connection == 0) attempt_at(port.next_attempt);
    return wait < 0 ? -1 : static_cast<int>(wait / 1'000'000 + 1);
  }

  const std::size_t largest_;
  ArrivalQueue queue_;
  SendQueue outgoing_;
  std::string buffer_;
  File wake_;
  std::vector<Datagrams> datagrams_;
  std::vector<Listener> listeners_;
  std::vector<Port> ports_;
  std::vector<Stream> streams_;
  bool has_datagrams_ = false;
  bool closed_any_ = false;
  Nanoseconds accept_after_ = 0;
  std::uint64_t last_id_ = 0;
  // Written by the thread, read by `counters`.
  std::atomic<std::uint64_t> opened_{0}, first_{0}, connections_{0}, refused_size_{0}, refused_cut_{0}, superseded_{0};
  std::atomic<bool> stop_{false}, is_released_{false};
  std::string release_packet_;
  std::thread thread_;
};

Intake::Intake(std::size_t largest, std::size_t slots) : impl_(std::make_unique<Impl>(largest, slots)) {}
Intake::~Intake() = default;
std::uint16_t Intake::listen_udp(const std::string& address, std::int64_t port) {
  return impl_->listen_udp(address, port);
}
std::uint16_t Intake::listen_tcp(const std::string& address, std::int64_t port, Framing framing) {
  return impl_->listen_tcp(address, port, framing);
}
void Intake::connect_udp(const std::string& address, std::int64_t port) { impl_->connect_udp(address, port); }
void Intake::join_udp(const std::string& address, const std::string& group, std::int64_t port,
                      const std::string& network) {
  impl_->join_udp(address, group, port, network);
}
void Intake::connect_tcp(const std::string& address, std::int64_t port, Framing framing, const std::string& greeting) {
  impl_->connect_tcp(address, port, framing, greeting);
}
void Intake::open_serial(const std::string& path, std::int64_t baud, Framing framing) {
  impl_->open_serial(path, baud, framing);
}
void Intake::translate(Translate translate) { queue().translate(std::move(translate)); }
void Intake::start() { impl_->start(); }
bool Intake::connected() const { return impl_->connected(); }
Intake::Counters Intake::counters() const { return impl_->counters(); }
void Intake::fill_status(LoopStatus& status) const {
  const Counters now = counters();
  add_counter(status, "passed_over", static_cast<double>(now.passed_over));
  if (!impl_->has_streams()) return;
  add_counter(status, "connections", static_cast<double>(now.connections));
  add_counter(status, "reconnects", static_cast<double>(now.reconnects));
  add_counter(status, "refused_cut", static_cast<double>(now.refused_cut));
}
void Intake::send(std::uint64_t connection, std::string_view bytes) { impl_->send(connection, bytes); }
void Intake::set_release(std::string bytes) { impl_->set_release(std::move(bytes)); }
void Intake::release() { impl_->release(); }
ArrivalQueue& Intake::queue() { return impl_->queue(); }

}  // namespace softhand
