#include "trackers/sockets/inbox.hpp"

#include <array>
#include <atomic>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ip/udp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <deque>
#include <mutex>
#include <set>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "runtime/clock.hpp"

namespace softhand {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = asio::ip::tcp;
using udp = asio::ip::udp;

constexpr std::size_t kWaiting = 64;
constexpr std::uint64_t kMaxConnections = 16;

// Of "name:port" or "[::1]:port".
std::string host_name(const std::string& authority) {
  const std::size_t colon = authority.rfind(':');
  const std::size_t bracket = authority.rfind(']');
  const bool has_port = colon != std::string::npos && (bracket == std::string::npos || colon > bracket);
  return has_port ? authority.substr(0, colon) : authority;
}

struct Shared {
  std::size_t largest = 0;
  std::set<std::string> hosts;
  std::atomic<std::uint64_t> connections{0}, refused_origin{0}, refused_size{0}, passed_over{0};
  std::uint64_t next_connection = 1;  // the server's thread alone
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

class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(tcp::socket&& socket, Shared& shared) : stream_(std::move(socket)), shared_(shared) {}
  ~Connection() {
    if (open_) --shared_.connections;
  }

  void start() {
    beast::get_lowest_layer(stream_).expires_after(std::chrono::seconds(10));
    http::async_read(stream_.next_layer(), buffer_, request_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (!error) self->answer();
    });
  }

 private:
  bool is_believed() const {
    const std::string host = host_name(std::string(request_[http::field::host]));
    if (shared_.hosts.count(host) == 0) return false;
    const std::string origin(request_[http::field::origin]);
    if (origin.empty()) return true;  // no browser leaves it out
    for (const std::string scheme : {"http://", "https://"}) {
      if (origin.rfind(scheme, 0) == 0) return host_name(origin.substr(scheme.size())) == host;
    }
    return false;
  }

  void answer() {
    if (!websocket::is_upgrade(request_) || !is_believed()) {
      const bool upgrade = websocket::is_upgrade(request_);
      if (upgrade) ++shared_.refused_origin;
      auto response = std::make_shared<http::response<http::string_body>>(upgrade ? http::status::forbidden : http::status::upgrade_required,
                                                                          request_.version());
      response->body() = upgrade ? "Pages of other sites may not connect.\n" : "A WebSocket is spoken here.\n";
      response->keep_alive(false);
      response->prepare_payload();
      http::async_write(stream_.next_layer(), *response, [self = shared_from_this(), response](beast::error_code, std::size_t) {
        beast::error_code ignored;
        self->stream_.next_layer().socket().shutdown(tcp::socket::shutdown_send, ignored);
      });
      return;
    }
    if (shared_.connections >= kMaxConnections) return;
    open_ = true;
    ++shared_.connections;
    id_ = shared_.next_connection++;
    beast::get_lowest_layer(stream_).expires_never();
    stream_.set_option(websocket::stream_base::timeout::suggested(beast::role_type::server));
    stream_.read_message_max(shared_.largest);
    stream_.async_accept(request_, [self = shared_from_this()](beast::error_code error) {
      self->buffer_.clear();
      if (!error) self->read();
    });
  }

  void read() {
    stream_.async_read(buffer_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) {
        if (error == websocket::error::message_too_big) ++self->shared_.refused_size;
        return;
      }
      self->shared_.add({beast::buffers_to_string(self->buffer_.cdata()), now(), self->id_, self->stream_.got_binary()});
      self->buffer_.clear();
      self->read();
    });
  }

  websocket::stream<beast::tcp_stream> stream_;
  Shared& shared_;
  beast::flat_buffer buffer_{1 << 16};
  http::request<http::empty_body> request_;
  std::uint64_t id_ = 0;
  bool open_ = false;
};

}  // namespace

class Inbox::Impl {
 public:
  Impl(const SocketOptions& options, Transport transport, std::size_t largest) : acceptor_(context_), datagrams_(context_) {
    shared_.largest = largest;
    shared_.hosts = {"localhost", "127.0.0.1", "[::1]", options.address};
    std::istringstream hosts(options.hosts);
    for (std::string host; hosts >> host;) shared_.hosts.insert(host);
    try {
      const auto address = asio::ip::make_address(options.address);
      const tcp::endpoint endpoint(address, static_cast<std::uint16_t>(options.port));
      acceptor_.open(endpoint.protocol());
      acceptor_.set_option(asio::socket_base::reuse_address(true));
      acceptor_.bind(endpoint);
      acceptor_.listen();
      port_ = acceptor_.local_endpoint().port();
      if (transport == Transport::websocket_and_udp) {
        datagrams_.open(address.is_v6() ? udp::v6() : udp::v4());
        datagrams_.bind(udp::endpoint(address, port_));
        datagram_.resize(largest + 1);
        receive();
      }
    } catch (const boost::system::system_error& error) {
      throw std::runtime_error("cannot listen on " + options.address + ":" + std::to_string(options.port) + ": " + error.what());
    }
    accept();
    thread_ = std::thread([this] { context_.run(); });
  }
  ~Impl() {
    context_.stop();
    thread_.join();
  }
  Shared& shared() { return shared_; }
  std::uint16_t port() const { return port_; }

 private:
  void accept() {
    acceptor_.async_accept([this](beast::error_code error, tcp::socket socket) {
      if (!error) {
        beast::error_code ignored;
        socket.set_option(tcp::no_delay(true), ignored);
        std::make_shared<Connection>(std::move(socket), shared_)->start();
      }
      accept();
    });
  }

  void receive() {
    datagrams_.async_receive_from(asio::buffer(datagram_), sender_, [this](beast::error_code error, std::size_t size) {
      // A datagram that fills the buffer is longer than allowed: the buffer has a byte to spare.
      if (!error && size > shared_.largest) ++shared_.refused_size;
      if (!error && size <= shared_.largest) shared_.add({datagram_.substr(0, size), now(), 0, false});
      receive();
    });
  }

  Shared shared_;  // outlives the connections, which die with the context
  asio::io_context context_{1};
  tcp::acceptor acceptor_;
  udp::socket datagrams_;
  udp::endpoint sender_;
  std::string datagram_;
  std::uint16_t port_ = 0;
  std::thread thread_;
};

Inbox::Inbox(const SocketOptions& options, Transport transport, std::size_t largest)
    : impl_(std::make_unique<Impl>(options, transport, largest)) {}
Inbox::~Inbox() = default;
std::uint16_t Inbox::port() const { return impl_->port(); }

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
