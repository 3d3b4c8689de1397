#include "device/websocket_client.hpp"

#include <sys/eventfd.h>
#include <unistd.h>

#include <atomic>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <stdexcept>
#include <thread>
#include <utility>

#include "device/health.hpp"
#include "device/stream_socket.hpp"
#include "messages/convert.hpp"
#include "runtime/clock.hpp"
#include "runtime/scheduling.hpp"

namespace softhand {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = beast::websocket;
using tcp = asio::ip::tcp;

constexpr std::size_t kOutgoing = 64;
constexpr std::chrono::seconds kOpenTime{2};  // of a connection, and again of its handshake
constexpr std::chrono::milliseconds kLastMessageTime{50};

tcp::endpoint endpoint_of(const WebSocketClient::Server& server) {
  beast::error_code error;
  const auto address = asio::ip::make_address(server.address, error);
  if (error) throw std::invalid_argument("address '" + server.address + "': expected a numeric address, as 127.0.0.1");
  return {address, static_cast<std::uint16_t>(server.port)};
}

}  // namespace

class WebSocketClient::Impl {
 public:
  Impl(const Server& server, std::size_t largest, std::size_t slots)
      : largest_(largest),
        server_(server),
        endpoint_(endpoint_of(server)),
        queue_(largest, slots),
        outgoing_(largest, kOutgoing),
        wake_number_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    if (wake_number_ < 0) throw std::runtime_error(std::string("eventfd: ") + std::strerror(errno));
    wake_.assign(wake_number_);
    next_.reserve(largest);
  }
  ~Impl() {
    stop_ = true;
    wake();
    if (thread_.joinable()) thread_.join();
  }
  void start() {
    thread_ = std::thread([this] {
      become_ordinary();
      wait_for_wake();
      connect();
      context_.run();
    });
  }
  void send(std::string_view text) {
    outgoing_.push({text, 0, 0, false});
    wake();
  }
  ArrivalQueue& queue() { return queue_; }
  bool connected() const { return open_; }
  Intake::Counters counters() const {
    const std::uint64_t opened = opened_;
    Intake::Counters out;
    out.connections = open_ ? 1 : 0;
    out.reconnects = opened > 0 ? opened - 1 : 0;
    out.refused_size = refused_size_;
    out.passed_over = queue_.passed_over();
    out.superseded = superseded_ + outgoing_.superseded();
    return out;
  }

 private:
  // One connection. Its handlers own it, and do nothing once it is not the newest one.
  struct Connection {
    explicit Connection(asio::io_context& context) : stream(context) {}
    websocket::stream<beast::tcp_stream> stream;
    beast::flat_buffer received;
    std::string sending;
    std::size_t greetings = 0;  // sent
    bool is_open = false, is_writing = false;
  };
  using Shared = std::shared_ptr<Connection>;

  void wake() const {
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t ignored = write(wake_number_, &one, sizeof one);
  }

  void wait_for_wake() {
    wake_.async_wait(asio::posix::stream_descriptor::wait_read, [this](beast::error_code error) {
      if (error) return;
      std::uint64_t wakes = 0;
      [[maybe_unused]] const ssize_t ignored = read(wake_number_, &wakes, sizeof wakes);
      // A message that was pushed before `stop_` was set is taken below.
      const bool ends = stop_;
      outgoing_.take([this](const Arrival& message) {
        if (!open_) return;
        if (!next_.empty()) ++superseded_;
        next_ = message.bytes;
      });
      write_next(connection_);
      if (ends) return finish();
      wait_for_wake();
    });
  }

  void connect() {
    const auto connection = std::make_shared<Connection>(context_);
    connection_ = connection;
    auto& socket = beast::get_lowest_layer(connection->stream);
    socket.expires_after(kOpenTime);
    socket.async_connect(endpoint_, [this, connection](beast::error_code error) {
      if (error) return lose(connection, error);
      auto& stream = connection->stream;
      auto& lowest = beast::get_lowest_layer(stream);
      lowest.expires_never();
      watch_peer(lowest.socket().native_handle());
      stream.set_option(websocket::stream_base::timeout{kOpenTime, websocket::stream_base::none(), false});
      stream.read_message_max(largest_);
      stream.auto_fragment(false);
      stream.text(true);
      const std::string host = (endpoint_.address().is_v6() ? "[" + server_.address + "]" : server_.address) + ":" +
                               std::to_string(server_.port);
      stream.async_handshake(host, server_.target, [this, connection](beast::error_code failure) {
        if (failure) return lose(connection, failure);
        connection->is_open = true;
        backoff_.reset();
        ++opened_;
        open_ = true;
        receive(connection);
        write_next(connection);
      });
    });
  }

  void receive(const Shared& connection) {
    connection->stream.async_read(connection->received, [this, connection](beast::error_code error, std::size_t) {
      if (error) return lose(connection, error);
      const auto data = connection->received.cdata();
      queue_.push(
          {{static_cast<const char*>(data.data()), data.size()}, now(), opened_, connection->stream.got_binary()});
      connection->received.clear();
      receive(connection);
    });
  }

  void write_next(const Shared& connection) {
    if (connection == nullptr || !connection->is_open || connection->is_writing) return;
    if (connection->greetings < server_.greeting.size()) {
      connection->sending = server_.greeting[connection->greetings++];
    } else if (!next_.empty()) {
      std::swap(connection->sending, next_);
      next_.clear();
    } else {
      return;
    }
    connection->is_writing = true;
    connection->stream.async_write(asio::buffer(connection->sending),
                                   [this, connection](beast::error_code error, std::size_t) {
                                     connection->is_writing = false;
                                     if (error) return lose(connection, error);
                                     write_next(connection);
                                     if (is_ending_) close_if_idle();
                                   });
  }

  void lose(const Shared& connection, beast::error_code error) {
    if (connection != connection_) return;
    if (error == websocket::error::message_too_big) ++refused_size_;
    connection_ = nullptr;
    open_ = false;
    next_.clear();
    beast::get_lowest_layer(connection->stream).close();
    if (is_ending_) return context_.stop();
    timer_.expires_after(std::chrono::nanoseconds(backoff_.next()));
    timer_.async_wait([this](beast::error_code cancelled) {
      if (!cancelled) connect();
    });
  }

  // Ends the thread as soon as the last message was sent and the service knows of the end.
  void finish() {
    is_ending_ = true;
    if (connection_ == nullptr || !connection_->is_open) return context_.stop();
    timer_.expires_after(kLastMessageTime);
    timer_.async_wait([this](beast::error_code) { context_.stop(); });
    close_if_idle();
  }
  void close_if_idle() {
    if (connection_ == nullptr || connection_->is_writing) return;
    connection_->stream.async_close(websocket::close_code::normal,
                                    [this, connection = connection_](beast::error_code) { context_.stop(); });
  }

  const std::size_t largest_;
  const Server server_;
  const tcp::endpoint endpoint_;
  ArrivalQueue queue_;
  SendQueue outgoing_;
  asio::io_context context_{1};
  asio::posix::stream_descriptor wake_{context_};  // owns wake_number_
  const int wake_number_;
  asio::steady_timer timer_{context_};
  Shared connection_;
  std::string next_;  // the newest message, which waits behind the one that is being sent
  Backoff backoff_;
  bool is_ending_ = false;
  // Written by the thread, read by `counters`.
  std::atomic<std::uint64_t> opened_{0}, refused_size_{0}, superseded_{0};
  std::atomic<bool> open_{false}, stop_{false};
  std::thread thread_;
};

WebSocketClient::WebSocketClient(const Server& server, std::size_t largest, std::size_t slots)
    : impl_(std::make_unique<Impl>(server, largest, slots)) {}
WebSocketClient::~WebSocketClient() = default;
void WebSocketClient::translate(Translate translate) { impl_->queue().translate(std::move(translate)); }
void WebSocketClient::start() { impl_->start(); }
void WebSocketClient::send(std::string_view text) { impl_->send(text); }
bool WebSocketClient::connected() const { return impl_->connected(); }
Intake::Counters WebSocketClient::counters() const { return impl_->counters(); }
void WebSocketClient::fill_status(LoopStatus& status) const {
  const Intake::Counters now = counters();
  add_counter(status, "passed_over", static_cast<double>(now.passed_over));
  add_counter(status, "superseded", static_cast<double>(now.superseded));
  add_counter(status, "connections", static_cast<double>(now.connections));
  add_counter(status, "reconnects", static_cast<double>(now.reconnects));
}
ArrivalQueue& WebSocketClient::queue() { return impl_->queue(); }

}  // namespace softhand
