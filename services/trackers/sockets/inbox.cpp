#include "trackers/sockets/inbox.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <deque>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <thread>

#include "runtime/clock.hpp"
#include "runtime/scheduling.hpp"
#include "web/web_server.hpp"

namespace softhand {
namespace {

constexpr std::size_t kWaiting = 64;
constexpr std::uint64_t kMaxConnections = 16;

struct Shared {
  std::atomic<std::uint64_t> connections{0}, refused_origin{0}, refused_size{0}, passed_over{0};
  std::uint64_t next_connection = 1;  // used only by the server's thread
  std::mutex mutex;
  std::deque<Arrival> arrivals;

  void add(Arrival arrival) {
    const std::lock_guard lock(mutex);
    arrivals.push_back(std::move(arrival));
    if (arrivals.size() <= kWaiting) return;
    arrivals.pop_front();
    ++passed_over;
  }
};

class Sender : public web::Session {
 public:
  explicit Sender(Shared& shared) : shared_(shared), id_(shared.next_connection++) { ++shared_.connections; }
  void opened(web::Socket&) override {}
  void received(std::string_view bytes, bool binary) override { shared_.add({std::string(bytes), now(), id_, binary}); }
  void sent(std::size_t) override {}
  void closed(bool too_large) override {
    --shared_.connections;
    if (too_large) ++shared_.refused_size;
  }

 private:
  Shared& shared_;
  std::uint64_t id_;
};

// Receives datagrams in its own thread.
class Datagrams {
 public:
  Datagrams(const std::string& address, std::uint16_t port, std::size_t largest, Shared& shared)
      : shared_(shared), buffer_(largest + 1, '\0') {
    sockaddr_storage to{};
    auto& four = reinterpret_cast<sockaddr_in&>(to);
    auto& six = reinterpret_cast<sockaddr_in6&>(to);
    const bool is_six = inet_pton(AF_INET6, address.c_str(), &six.sin6_addr) == 1;
    if (is_six) {
      six.sin6_family = AF_INET6;
      six.sin6_port = htons(port);
    } else {
      inet_pton(AF_INET, address.c_str(), &four.sin_addr);
      four.sin_family = AF_INET;
      four.sin_port = htons(port);
    }
    socket_ = socket(to.ss_family, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    wake_ = eventfd(0, EFD_CLOEXEC);
    if (socket_ < 0 || wake_ < 0 ||
        bind(socket_, reinterpret_cast<const sockaddr*>(&to), is_six ? sizeof six : sizeof four) != 0) {
      const std::string why = std::strerror(errno);
      close_all();
      throw std::runtime_error("cannot listen on UDP " + address + ":" + std::to_string(port) + ": " + why);
    }
    thread_ = std::thread([this] {
      become_ordinary();
      receive();
    });
  }
  ~Datagrams() {
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t ignored = write(wake_, &one, sizeof one);
    thread_.join();
    close_all();
  }

 private:
  void close_all() const {
    for (const int file : {socket_, wake_})
      if (file >= 0) close(file);
  }

  void receive() {
    for (;;) {
      pollfd files[2] = {{socket_, POLLIN, 0}, {wake_, POLLIN, 0}};
      if (poll(files, 2, -1) < 0 && errno != EINTR) return;
      if (files[1].revents != 0) return;
      if (files[0].revents == 0) continue;
      const ssize_t size = recv(socket_, buffer_.data(), buffer_.size(), MSG_DONTWAIT);
      if (size < 0) continue;
      // The buffer has one spare byte. A datagram that fills it is longer than allowed.
      if (static_cast<std::size_t>(size) == buffer_.size()) {
        ++shared_.refused_size;
      } else {
        shared_.add({buffer_.substr(0, static_cast<std::size_t>(size)), now(), 0, false});
      }
    }
  }

  Shared& shared_;
  std::string buffer_;
  int socket_ = -1;
  int wake_ = -1;
  std::thread thread_;
};

}  // namespace

class Inbox::Impl {
 public:
  Impl(const web::Listening& listening, Transport transport, std::size_t largest) : web_(listening, site(largest)) {
    if (transport == Transport::websocket_and_udp) datagrams_.emplace(listening.address, web_.port(), largest, shared_);
  }
  Shared& shared() { return shared_; }
  const web::WebServer& web() const { return web_; }

 private:
  web::Site site(std::size_t largest) {
    web::Site site;
    site.get = [](const std::string&) {
      return web::Answer{426, "text/plain", "This port accepts only WebSocket connections.\n"};
    };
    site.origin = web::Origin::this_host;
    site.largest_message = largest;
    site.connect = [this](bool) {
      return shared_.connections < kMaxConnections ? std::make_shared<Sender>(shared_) : nullptr;
    };
    site.refused = [this] { ++shared_.refused_origin; };
    return site;
  }

  Shared shared_;
  web::WebServer web_;
  std::optional<Datagrams> datagrams_;
};

Inbox::Inbox(const web::Listening& listening, Transport transport, std::size_t largest)
    : impl_(std::make_unique<Impl>(listening, transport, largest)) {}
Inbox::~Inbox() = default;
std::uint16_t Inbox::port() const { return impl_->web().port(); }

std::string Inbox::url() const {
  std::string url = impl_->web().url();
  return url.replace(0, 4, "ws");
}

void Inbox::take(std::vector<Arrival>& out) {
  out.clear();
  Shared& shared = impl_->shared();
  const std::lock_guard lock(shared.mutex);
  for (Arrival& arrival : shared.arrivals) out.push_back(std::move(arrival));
  shared.arrivals.clear();
}

Inbox::Counters Inbox::counters() const {
  const Shared& shared = impl_->shared();
  return {shared.connections, shared.refused_origin, shared.refused_size, shared.passed_over};
}

}  // namespace softhand
