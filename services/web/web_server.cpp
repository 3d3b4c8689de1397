#include "web/web_server.hpp"

#include <algorithm>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/http/span_body.hpp>
#include <boost/beast/ssl.hpp>
#include <boost/beast/websocket.hpp>
#include <boost/beast/websocket/ssl.hpp>
#include <cctype>
#include <chrono>
#include <optional>
#include <random>
#include <set>
#include <sstream>
#include <stdexcept>
#include <thread>
#include <type_traits>

#include "runtime/config.hpp"
#include "runtime/scheduling.hpp"

namespace softhand::web {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace ssl = asio::ssl;
namespace websocket = beast::websocket;
using tcp = asio::ip::tcp;
using Plain = beast::tcp_stream;
using Encrypted = beast::ssl_stream<beast::tcp_stream>;
using Request = http::request<http::string_body>;

// bytes that the kernel may buffer for a connection. It bounds the age of the picture on a slow page.
constexpr int kSendBuffer = 256 * 1024;
constexpr std::size_t kLargestRequest = 16384;          // bytes, HTTP
constexpr std::chrono::seconds kTimeout{30};            // timeout of a request or a handshake
constexpr std::chrono::milliseconds kAcceptPause{100};  // pause after a connection that could not be accepted

std::string_view view(beast::string_view text) { return {text.data(), text.size()}; }

// Host names are case-insensitive. Browsers send them in lower case.
std::string lower_case(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

// Host name of "name:port" or "[::1]:port".
std::string host_name(std::string_view authority) {
  const std::size_t colon = authority.rfind(':');
  const std::size_t bracket = authority.rfind(']');
  if (colon != std::string_view::npos && (bracket == std::string_view::npos || colon > bracket))
    authority = authority.substr(0, colon);
  return lower_case(std::string(authority));
}

// A name or an address as in URLs. An IPv6 address is in brackets, because it contains colons.
std::string in_url(const std::string& host) {
  beast::error_code error;
  const auto address = asio::ip::make_address_v6(host, error);
  return error ? lower_case(host) : "[" + address.to_string() + "]";
}

bool is_local_name(const std::string& host) { return host == "localhost" || host == "127.0.0.1" || host == "[::1]"; }

bool is_loopback(const asio::ip::address& address) {
  if (address.is_v6() && address.to_v6().is_v4_mapped())
    return asio::ip::make_address_v4(asio::ip::v4_mapped, address.to_v6()).is_loopback();
  return address.is_loopback();
}

// 50 random bits, short enough to type on a headset. Letters that look like digits are left out.
std::string random_token() {
  constexpr std::string_view kLetters = "23456789abcdefghijkmnpqrstuvwxyz";
  std::random_device random;
  std::string token;
  for (int i = 0; i < 10; ++i) token += kLetters[random() % kLetters.size()];
  return token;
}

// Takes the same time wherever the texts differ.
bool is_equal(std::string_view a, std::string_view b) {
  unsigned difference = a.size() == b.size() ? 0 : 1;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i)
    difference |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]);
  return difference == 0;
}

// Value of `token` in the part of a target after the question mark.
std::string_view token_in(std::string_view target) {
  constexpr std::string_view kKey = "token=";
  for (std::size_t at = target.find('?'); at != std::string_view::npos; at = target.find('&', at + 1)) {
    const std::string_view rest = target.substr(at + 1);
    if (rest.substr(0, kKey.size()) == kKey) return rest.substr(kKey.size(), rest.find('&') - kKey.size());
  }
  return {};
}

// One of the limited number of connections. Own programs and those of other machines are counted apart, so that others
// cannot lock out the user.
class Place {
 public:
  Place(std::size_t& taken, bool is_local) : taken_(&taken), is_local_(is_local) { ++taken; }
  Place(Place&& other) noexcept : taken_(std::exchange(other.taken_, nullptr)), is_local_(other.is_local_) {}
  ~Place() {
    if (taken_ != nullptr) --*taken_;
  }
  /// The other end is a program of this machine, by its address.
  bool is_local() const { return is_local_; }

 private:
  std::size_t* taken_;
  bool is_local_;
};

struct Shared {
  Site site;
  std::set<std::string> hosts;
  std::optional<ssl::context> tls;
  std::string token;                           // empty: nobody else can connect
  std::size_t taken_here = 0, taken_away = 0;  // places

  bool is_trusted(const Place& place, std::string_view target) const {
    return place.is_local() || (!token.empty() && is_equal(token_in(target), token));
  }

  bool has_allowed_host(const Request& request) const {
    return hosts.count(host_name(view(request[http::field::host]))) != 0;
  }

  bool has_allowed_origin(const Request& request) const {
    const std::string_view origin = view(request[http::field::origin]);
    if (origin.empty()) return true;  // every browser sends an Origin
    const std::string_view host = view(request[http::field::host]);
    for (const std::string_view scheme : {"http://", "https://"}) {
      if (origin.substr(0, scheme.size()) != scheme) continue;
      const std::string_view from = origin.substr(scheme.size());
      return site.origin == Origin::here ? from == host : host_name(from) == host_name(host);
    }
    return false;
  }
};

template <typename Stream>
class SocketOf : public Socket, public std::enable_shared_from_this<SocketOf<Stream>> {
 public:
  SocketOf(Stream&& stream, Place place, std::shared_ptr<Session> session)
      : stream_(std::move(stream)), place_(std::move(place)), session_(std::move(session)) {}

  void accept(const Request& request, std::size_t largest) {
    beast::get_lowest_layer(stream_).expires_never();
    stream_.set_option(websocket::stream_base::timeout::suggested(beast::role_type::server));
    stream_.read_message_max(largest);
    stream_.binary(true);
    stream_.auto_fragment(false);
    stream_.async_accept(request, [self = this->shared_from_this()](beast::error_code error) {
      if (error) return self->finish(error);
      self->session_->opened(*self);
      self->read();
    });
  }

  void send(std::vector<Bytes> parts) override {
    parts_ = std::move(parts);
    std::vector<asio::const_buffer> buffers;
    for (const Bytes& part : parts_) buffers.emplace_back(part->data(), part->size());
    writing_ = true;
    stream_.async_write(buffers, [self = this->shared_from_this()](beast::error_code error, std::size_t bytes) {
      self->writing_ = false;
      if (error || self->gone_) return self->finish(error);
      self->session_->sent(bytes);
      if (self->closing_ && !self->writing_) self->start_close_handshake();
    });
  }

  void close() override {
    if (closing_) return;
    closing_ = true;
    if (!writing_) start_close_handshake();
  }

 private:
  void read() {
    stream_.async_read(buffer_, [self = this->shared_from_this()](beast::error_code error, std::size_t) {
      if (error) return self->finish(error);
      const auto data = self->buffer_.cdata();
      self->session_->received({static_cast<const char*>(data.data()), data.size()}, self->stream_.got_binary());
      self->buffer_.clear();
      if (!self->closing_) self->read();
    });
  }

  void start_close_handshake() {
    stream_.async_close(websocket::close_code::policy_error,
                        [self = this->shared_from_this()](beast::error_code error) { self->finish(error); });
  }

  void finish(beast::error_code error) {
    if (std::exchange(gone_, true)) return;
    session_->closed(error == websocket::error::message_too_big);
    beast::get_lowest_layer(stream_).close();
  }

  websocket::stream<Stream> stream_;
  Place place_;
  std::shared_ptr<Session> session_;
  beast::flat_buffer buffer_;
  std::vector<Bytes> parts_;
  bool writing_ = false;
  bool closing_ = false;
  bool gone_ = false;
};

// One HTTP connection. It is answered, or it becomes a WebSocket.
template <typename Stream>
class HttpConnection : public std::enable_shared_from_this<HttpConnection<Stream>> {
 public:
  HttpConnection(Stream&& stream, Place place, beast::flat_buffer&& buffer, Shared& shared)
      : stream_(std::move(stream)), place_(std::move(place)), shared_(shared), buffer_(std::move(buffer)) {}

  void start() {
    if constexpr (std::is_same_v<Stream, Encrypted>) {
      beast::get_lowest_layer(stream_).expires_after(kTimeout);
      stream_.async_handshake(ssl::stream_base::server, buffer_.data(),
                              [self = this->shared_from_this()](beast::error_code error, std::size_t used) {
                                self->buffer_.consume(used);
                                if (!error) self->read();
                              });
    } else {
      read();
    }
  }

 private:
  void read() {
    request_ = {};
    beast::get_lowest_layer(stream_).expires_after(kTimeout);
    http::async_read(stream_, buffer_, request_,
                     [self = this->shared_from_this()](beast::error_code error, std::size_t) {
                       if (!error) self->answer();
                     });
  }

  void answer() {
    const bool upgrade = websocket::is_upgrade(request_);
    const std::string host(view(request_[http::field::host]));
    if (!shared_.has_allowed_host(request_)) {
      shared_.site.refused();
      return respond({403, "text/plain", "This server does not accept this host name (option `hosts`).\n"});
    }
    const std::string target(view(request_.target()));
    const bool is_local = place_.is_local() && is_local_name(host_name(host));
    if (std::is_same_v<Stream, Plain> && shared_.tls && !is_local)
      return respond({301, "text/plain", "Use https.\n"}, "https://" + host + target);
    const std::string path = target.substr(0, target.find('?'));
    if (upgrade) return connect(path);
    if (request_.method() != http::verb::get && request_.method() != http::verb::head)
      return respond({405, "text/plain", "Use GET or HEAD.\n"});
    respond(shared_.site.get(path));
  }

  void connect(const std::string& path) {
    if (!shared_.has_allowed_origin(request_)) {
      shared_.site.refused();
      return respond({403, "text/plain", "Pages of other sites may not connect.\n"});
    }
    if (!shared_.site.socket_path.empty() && path != shared_.site.socket_path)
      return respond({404, "text/plain", "There is no WebSocket at this path.\n"});
    std::shared_ptr<Session> session = shared_.site.connect(shared_.is_trusted(place_, view(request_.target())));
    if (!session) return respond({503, "text/plain", "Too many connections.\n"});
    std::make_shared<SocketOf<Stream>>(std::move(stream_), std::move(place_), std::move(session))
        ->accept(request_, shared_.site.largest_message);
  }

  void respond(const Answer& answer, const std::string& elsewhere = "") {
    using Body = http::span_body<const char>;  // the text outlives the server, so it is not copied
    auto response =
        std::make_shared<http::response<Body>>(static_cast<http::status>(answer.status), request_.version());
    response->set(http::field::content_type, beast::string_view(answer.type.data(), answer.type.size()));
    response->set(http::field::cache_control, "no-cache");
    response->set("X-Content-Type-Options", "nosniff");
    response->set("Content-Security-Policy",
                  "default-src 'self'; connect-src 'self' ws: wss:; style-src 'self' 'unsafe-inline'; img-src 'self' "
                  "data: blob:; "
                  "frame-ancestors 'self'");
    if (!elsewhere.empty()) response->set(http::field::location, elsewhere);
    response->keep_alive(request_.keep_alive() && elsewhere.empty());
    response->content_length(answer.body.size());
    if (request_.method() != http::verb::head) response->body() = {answer.body.data(), answer.body.size()};
    // Start a new timeout for the answer. The timeout of the request began at the previous answer and may be almost
    // over.
    beast::get_lowest_layer(stream_).expires_after(kTimeout);
    http::async_write(stream_, *response,
                      [self = this->shared_from_this(), response](beast::error_code error, std::size_t) {
                        if (!error && response->keep_alive()) return self->read();
                        beast::error_code ignored;
                        beast::get_lowest_layer(self->stream_).socket().shutdown(tcp::socket::shutdown_send, ignored);
                      });
  }

  Stream stream_;
  Place place_;
  Shared& shared_;
  beast::flat_buffer buffer_;
  Request request_;
};

template <typename Stream>
void start_connection(Stream&& stream, Place place, beast::flat_buffer&& buffer, Shared& shared) {
  std::make_shared<HttpConnection<Stream>>(std::move(stream), std::move(place), std::move(buffer), shared)->start();
}

// Detects whether a connection uses TLS.
class TlsDetector : public std::enable_shared_from_this<TlsDetector> {
 public:
  TlsDetector(Plain&& stream, Place place, Shared& shared)
      : stream_(std::move(stream)), place_(std::move(place)), shared_(shared) {}
  void start() {
    stream_.expires_after(kTimeout);
    beast::async_detect_ssl(stream_, buffer_, [self = shared_from_this()](beast::error_code error, bool encrypted) {
      if (error) return;
      if (encrypted) {
        start_connection(Encrypted(std::move(self->stream_), *self->shared_.tls), std::move(self->place_),
                         std::move(self->buffer_), self->shared_);
      } else {
        start_connection(std::move(self->stream_), std::move(self->place_), std::move(self->buffer_), self->shared_);
      }
    });
  }

 private:
  Plain stream_;
  Place place_;
  Shared& shared_;
  beast::flat_buffer buffer_{kLargestRequest};
};

ssl::context tls_of(const Listening& listening) {
  ssl::context context(ssl::context::tls_server);
  context.set_options(ssl::context::default_workarounds | ssl::context::no_tlsv1 | ssl::context::no_tlsv1_1);
  beast::error_code error;
  context.use_certificate_chain_file(listening.certificate, error);
  if (error) throw ConfigError("certificate " + listening.certificate + ": " + error.message());
  context.use_private_key_file(listening.key, ssl::context::pem, error);
  if (error) throw ConfigError("key " + listening.key + ": " + error.message());
  return context;
}

}  // namespace

class WebServer::Impl {
 public:
  Impl(const Listening& listening, Site&& site, int ports) : acceptor_(context_) {
    shared_.site = std::move(site);
    if (!listening.certificate.empty()) shared_.tls = tls_of(listening);
    listen(listening, ports);
    if (shared_.site.controls && !is_loopback(acceptor_.local_endpoint().address()))
      shared_.token = listening.token.empty() ? random_token() : listening.token;
    const auto url_of = [this](const std::string& host) {
      return (shared_.tls ? "https://" : "http://") + host + ":" + std::to_string(port());
    };
    const std::string query = shared_.token.empty() ? "" : "/?token=" + shared_.token;
    const bool everywhere = acceptor_.local_endpoint().address().is_unspecified();
    url_ = everywhere ? url_of("localhost") : url_of(in_url(listening.address)) + query;
    shared_.hosts = {"localhost", "127.0.0.1", "[::1]", in_url(listening.address)};
    std::istringstream hosts(listening.hosts);
    for (std::string host; hosts >> host;) {
      shared_.hosts.insert(in_url(host));
      if (everywhere) urls_elsewhere_.push_back(url_of(in_url(host)) + query);
    }
    accept();
    thread_ = std::thread([this] {
      become_ordinary();
      context_.run();
    });
  }

  ~Impl() {
    context_.stop();
    thread_.join();
  }

  std::uint16_t port() const { return acceptor_.local_endpoint().port(); }
  const std::string& url() const { return url_; }
  const std::vector<std::string>& urls_elsewhere() const { return urls_elsewhere_; }
  void post(std::function<void()>&& work) { asio::post(context_, std::move(work)); }

 private:
  void listen(const Listening& listening, int ports) {
    beast::error_code error;
    const auto address = asio::ip::make_address(listening.address, error);
    if (listening.token.find_first_not_of("0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz-_") !=
        std::string::npos)
      throw ConfigError("token: expected letters, digits, - and _");
    if (error) throw ConfigError("address: expected an IP address, not '" + listening.address + "'");
    const std::int64_t last = listening.port == 0 ? 0 : std::min<std::int64_t>(65535, listening.port + ports - 1);
    for (std::int64_t port = listening.port; port <= last; ++port) {
      const tcp::endpoint endpoint(address, static_cast<std::uint16_t>(port));
      acceptor_.open(endpoint.protocol(), error);
      if (!error) acceptor_.set_option(asio::socket_base::reuse_address(true), error);
      if (!error) acceptor_.bind(endpoint, error);
      if (!error) acceptor_.listen(asio::socket_base::max_listen_connections, error);
      if (!error) return;
      acceptor_.close();
      if (error != asio::error::address_in_use) break;
    }
    throw std::runtime_error("cannot listen on " + listening.address + ":" + std::to_string(listening.port) + ": " +
                             error.message());
  }

  void accept() {
    acceptor_.async_accept([this](beast::error_code error, tcp::socket socket) {
      if (error == asio::error::operation_aborted) return;
      if (error) {
        // For example no file descriptor is free. The connection still waits, so an immediate retry would fail again
        // and again and use a whole core. Therefore pause.
        pause_.expires_after(kAcceptPause);
        return pause_.async_wait([this](beast::error_code) { accept(); });
      }
      start(std::move(socket));
      accept();
    });
  }

  // Closes the connection if there is no place for it.
  void start(tcp::socket socket) {
    beast::error_code error;
    const bool is_local = is_loopback(socket.remote_endpoint(error).address());
    if (error) return;
    std::size_t& taken = is_local ? shared_.taken_here : shared_.taken_away;
    if (taken >= shared_.site.most_connections) return;
    Place place(taken, is_local);
    socket.set_option(tcp::no_delay(true), error);
    socket.set_option(asio::socket_base::send_buffer_size(kSendBuffer), error);
    if (shared_.tls) {
      std::make_shared<TlsDetector>(Plain(std::move(socket)), std::move(place), shared_)->start();
    } else {
      start_connection(Plain(std::move(socket)), std::move(place), beast::flat_buffer(kLargestRequest), shared_);
    }
  }

  Shared shared_;  // outlives the connections, which end with the context
  asio::io_context context_{1};
  tcp::acceptor acceptor_;
  asio::steady_timer pause_{context_};
  std::string url_;
  std::vector<std::string> urls_elsewhere_;
  std::thread thread_;
};

WebServer::WebServer(const Listening& listening, Site site, int ports)
    : impl_(std::make_unique<Impl>(listening, std::move(site), ports)) {}
WebServer::~WebServer() = default;
std::uint16_t WebServer::port() const { return impl_->port(); }
const std::string& WebServer::url() const { return impl_->url(); }
const std::vector<std::string>& WebServer::urls_elsewhere() const { return impl_->urls_elsewhere(); }
void WebServer::post(std::function<void()> work) { impl_->post(std::move(work)); }

}  // namespace softhand::web
