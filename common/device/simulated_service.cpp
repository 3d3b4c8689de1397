#include "device/simulated_service.hpp"

#include <fcntl.h>

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <deque>
#include <stdexcept>
#include <thread>
#include <utility>
#include <vector>

namespace softhand {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = asio::ip::tcp;

// A driver that a test starts must not inherit the sockets: they would stay open after the service.
void keep_from_children(int socket) { fcntl(socket, F_SETFD, FD_CLOEXEC); }

class Client : public std::enable_shared_from_this<Client> {
 public:
  Client(tcp::socket&& socket, const SimulatedService::Behaviour& behaviour)
      : stream_(std::move(socket)), behaviour_(behaviour) {}

  void start() {
    http::async_read(stream_.next_layer(), received_, request_,
                     [self = shared_from_this()](beast::error_code error, std::size_t) {
                       if (error || !websocket::is_upgrade(self->request_)) return self->end();
                       self->accept();
                     });
  }
  // A message before the end of the handshake would fail, and close the connection.
  void send(std::string text) {
    if (text.empty() || !is_open_ || is_ended_) return;
    waiting_.push_back(std::move(text));
    if (waiting_.size() == 1) write();
  }
  bool is_ended() const { return is_ended_; }

 private:
  void accept() {
    stream_.text(true);
    stream_.async_accept(request_, [self = shared_from_this()](beast::error_code error) {
      if (error) return self->end();
      self->is_open_ = true;
      const auto target = self->request_.target();
      if (self->behaviour_.opened) self->send(self->behaviour_.opened({target.data(), target.size()}));
      self->read();
    });
  }
  void read() {
    stream_.async_read(received_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) return self->end();
      const std::string message = beast::buffers_to_string(self->received_.cdata());
      self->received_.clear();
      if (self->behaviour_.received) self->send(self->behaviour_.received(message));
      self->read();
    });
  }
  void write() {
    stream_.async_write(asio::buffer(waiting_.front()),
                        [self = shared_from_this()](beast::error_code error, std::size_t) {
                          if (error) return self->end();
                          self->waiting_.pop_front();
                          if (!self->waiting_.empty()) self->write();
                        });
  }
  void end() {
    if (std::exchange(is_ended_, true)) return;
    beast::get_lowest_layer(stream_).close();
    if (is_open_ && behaviour_.closed) behaviour_.closed();
  }

  websocket::stream<beast::tcp_stream> stream_;
  const SimulatedService::Behaviour& behaviour_;
  http::request<http::empty_body> request_;
  beast::flat_buffer received_;
  std::deque<std::string> waiting_;
  bool is_open_ = false, is_ended_ = false;
};

}  // namespace

class SimulatedService::Impl {
 public:
  Impl(std::int64_t port, Behaviour&& behaviour) : behaviour_(std::move(behaviour)), acceptor_(context_) {
    const tcp::endpoint endpoint(asio::ip::address_v4::loopback(), static_cast<std::uint16_t>(port));
    beast::error_code error;
    acceptor_.open(endpoint.protocol());
    acceptor_.set_option(asio::socket_base::reuse_address(true));
    acceptor_.bind(endpoint, error);
    if (error) throw std::runtime_error("cannot listen on port " + std::to_string(port) + ": " + error.message());
    acceptor_.listen();
    keep_from_children(acceptor_.native_handle());
    accept();
    thread_ = std::thread([this] { context_.run(); });
  }
  ~Impl() {
    context_.stop();
    thread_.join();
  }
  std::uint16_t port() const { return acceptor_.local_endpoint().port(); }
  void send(std::string text) {
    asio::post(context_, [this, text = std::move(text)] {
      for (const auto& client : clients_) client->send(text);
    });
  }

 private:
  void accept() {
    acceptor_.async_accept([this](beast::error_code error, tcp::socket socket) {
      if (error) return;
      socket.set_option(tcp::no_delay(true));
      keep_from_children(socket.native_handle());
      std::erase_if(clients_, [](const auto& client) { return client->is_ended(); });
      clients_.push_back(std::make_shared<Client>(std::move(socket), behaviour_));
      clients_.back()->start();
      accept();
    });
  }

  const Behaviour behaviour_;
  asio::io_context context_{1};
  tcp::acceptor acceptor_;
  std::vector<std::shared_ptr<Client>> clients_;
  std::thread thread_;
};

SimulatedService::SimulatedService(std::int64_t port, Behaviour behaviour)
    : impl_(std::make_unique<Impl>(port, std::move(behaviour))) {}
SimulatedService::~SimulatedService() = default;
std::uint16_t SimulatedService::port() const { return impl_->port(); }
void SimulatedService::send(std::string text) { impl_->send(std::move(text)); }

}  // namespace softhand
