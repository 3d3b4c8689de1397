#include "viewer/server.hpp"

#include <algorithm>
#include <atomic>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <deque>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <set>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "runtime/clock.hpp"

namespace softhand::viewer {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = asio::ip::tcp;

constexpr std::size_t kLargestRequest = 4096;      // bytes of a message from a page
constexpr std::size_t kWaitingMessages = 64;       // not yet taken by the gateway's loop
constexpr std::uint64_t kRefusalsOfOnePage = 100;  // until it is closed
constexpr int kSendBuffer = 256 * 1024;            // bytes that the kernel may hold back from us: bounds how old a slow page's picture is

struct File {
  std::string body;
  std::string_view type;
};

std::string_view media_type(const std::filesystem::path& path) {
  static const std::map<std::string, std::string_view> types{{".html", "text/html; charset=utf-8"},
                                                             {".js", "text/javascript; charset=utf-8"},
                                                             {".css", "text/css; charset=utf-8"},
                                                             {".svg", "image/svg+xml"},
                                                             {".map", "application/json"},
                                                             {".txt", "text/plain; charset=utf-8"},
                                                             {".png", "image/png"},
                                                             {".webmanifest", "application/manifest+json"}};
  const auto found = types.find(path.extension().string());
  return found == types.end() ? "application/octet-stream" : found->second;
}

// All files, read once: no request can name a path outside.
std::map<std::string, File> read_files(const std::string& folder) {
  std::map<std::string, File> files;
  std::error_code error;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder, error)) {
    if (!entry.is_regular_file()) continue;
    std::ifstream in(entry.path(), std::ios::binary);
    std::stringstream body;
    body << in.rdbuf();
    files["/" + std::filesystem::relative(entry.path(), folder).generic_string()] = {body.str(), media_type(entry.path())};
  }
  if (const auto index = files.find("/index.html"); index != files.end()) files["/"] = index->second;
  return files;
}

// Of "name:port" or "[::1]:port".
std::string host_name(std::string_view authority) {
  const std::size_t colon = authority.rfind(':');
  const std::size_t bracket = authority.rfind(']');
  if (colon != std::string_view::npos && (bracket == std::string_view::npos || colon > bracket)) authority = authority.substr(0, colon);
  return std::string(authority);
}

std::string_view view(beast::string_view text) { return {text.data(), text.size()}; }

// What is known to all sessions. Only the server's thread touches it, but for the atomics and what the mutex guards.
struct Shared {
  std::map<std::string, File> files;
  std::set<std::string> hosts;
  std::size_t max_pages = 0;
  std::map<std::pair<FrameType, std::uint32_t>, Frame> kept;

  std::atomic<TypeSet> shown{0};
  std::atomic<std::uint32_t> pages{0};
  std::atomic<std::uint64_t> bytes_sent{0};
  std::atomic<std::uint64_t> frames_sent{0};
  std::atomic<std::uint64_t> frames_passed_over{0};
  std::array<std::atomic<std::uint64_t>, kRefusalNames.size()> refused{};
  std::mutex mutex;
  std::vector<Message> messages;

  void refuse(Refusal why) { refused[static_cast<std::size_t>(why)].fetch_add(1, std::memory_order_relaxed); }
};

class Page : public std::enable_shared_from_this<Page> {
 public:
  Page(tcp::socket&& socket, Shared& shared, std::function<void()> show_changed)
      : stream_(std::move(socket)), shared_(shared), show_changed_(std::move(show_changed)) {}

  TypeSet types() const { return open_ ? show_.types : 0; }
  bool gone() const { return gone_; }

  void accept(const http::request<http::string_body>& request) {
    stream_.set_option(websocket::stream_base::timeout::suggested(beast::role_type::server));
    stream_.read_message_max(kLargestRequest);
    stream_.binary(true);
    stream_.auto_fragment(false);
    stream_.async_accept(request, [self = shared_from_this()](beast::error_code error) {
      if (error) return self->leave();
      self->open_ = true;
      self->read();
    });
  }

  void offer(const Outgoing& outgoing) {
    if (!open_ || (outgoing.type != FrameType::gateway && (show_.types & set_of(outgoing.type)) == 0)) return;
    if (outgoing.type == FrameType::message_reply) {
      // Answers are no state: none replaces another. A page that does not take them loses the oldest.
      replies_.push_back(outgoing.frame);
      if (replies_.size() > kWaitingMessages) replies_.pop_front();
      return;
    }
    Frame& waiting = waiting_[{outgoing.type, outgoing.instance}];
    if (waiting != nullptr) shared_.frames_passed_over.fetch_add(1, std::memory_order_relaxed);
    waiting = outgoing.frame;
  }

  void flush(Nanoseconds at) {
    if (!open_ || writing_ || closing_ || (waiting_.empty() && replies_.empty())) return;
    // A hundredth of a period of grace, or a page that asks for the gateway's own rate would miss every other beat.
    if (show_.rate_hz > 0 && static_cast<double>(at - last_sent_) * 1e-9 * static_cast<double>(show_.rate_hz) < 0.9) return;
    last_sent_ = at;
    sending_.clear();
    buffers_.clear();
    for (auto& [key, frame] : waiting_) sending_.push_back(std::move(frame));
    waiting_.clear();
    sending_.insert(sending_.end(), replies_.begin(), replies_.end());
    replies_.clear();
    for (const Frame& frame : sending_) buffers_.emplace_back(frame->data(), frame->size());
    writing_ = true;
    stream_.async_write(buffers_, [self = shared_from_this()](beast::error_code error, std::size_t bytes) {
      self->writing_ = false;
      if (error) return self->leave();
      self->shared_.bytes_sent.fetch_add(bytes, std::memory_order_relaxed);
      self->shared_.frames_sent.fetch_add(self->sending_.size(), std::memory_order_relaxed);
      if (self->closing_) return self->close();
      self->flush(now());
    });
  }

 private:
  void read() {
    stream_.async_read(buffer_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) {
        if (error == websocket::error::message_too_big) self->shared_.refuse(Refusal::size);
        return self->leave();
      }
      self->take();
      self->buffer_.clear();
      if (!self->closing_) self->read();
    });
  }

  void take() {
    const auto data = buffer_.cdata();
    PageRequest request;
    Refusal refusal = stream_.got_binary() ? decode({static_cast<const std::uint8_t*>(data.data()), data.size()}, request) : Refusal::type;
    if (refusal == Refusal::none) {
      if (const auto* show = std::get_if<ShowRequest>(&request)) {
        change_show(*show);
      } else {
        const std::lock_guard lock(shared_.mutex);
        if (shared_.messages.size() < kWaitingMessages) {
          shared_.messages.push_back(std::get<Message>(request));
        } else {
          refusal = Refusal::flood;
        }
      }
    }
    if (refusal == Refusal::none) return;
    shared_.refuse(refusal);
    if (++refusals_ < kRefusalsOfOnePage) return;
    closing_ = true;
    if (!writing_) close();
  }

  void change_show(const ShowRequest& show) {
    const TypeSet fresh = show.types & ~show_.types;
    show_ = show;
    for (auto it = waiting_.begin(); it != waiting_.end();) {
      const bool shown = it->first.first == FrameType::gateway || (show_.types & set_of(it->first.first)) != 0;
      it = shown ? std::next(it) : waiting_.erase(it);
    }
    for (const auto& [key, frame] : shared_.kept) {
      if ((fresh & set_of(key.first)) != 0) offer({key.first, key.second, frame});
    }
    show_changed_();
    flush(now());
  }

  void close() {
    stream_.async_close(websocket::close_code::policy_error, [self = shared_from_this()](beast::error_code) { self->leave(); });
  }

  void leave() {
    open_ = false;
    gone_ = true;
    beast::get_lowest_layer(stream_).close();
    show_changed_();
  }

  websocket::stream<beast::tcp_stream> stream_;
  Shared& shared_;
  std::function<void()> show_changed_;
  beast::flat_buffer buffer_;
  ShowRequest show_;
  std::map<std::pair<FrameType, std::uint32_t>, Frame> waiting_;
  std::deque<Frame> replies_;
  std::vector<Frame> sending_;
  std::vector<asio::const_buffer> buffers_;
  Nanoseconds last_sent_ = 0;
  std::uint64_t refusals_ = 0;
  bool open_ = false;
  bool gone_ = false;
  bool writing_ = false;
  bool closing_ = false;
};

using NewPage = std::function<std::shared_ptr<Page>(tcp::socket&&)>;

// One HTTP connection: serves files, or becomes a page.
class Visitor : public std::enable_shared_from_this<Visitor> {
 public:
  Visitor(tcp::socket&& socket, Shared& shared, NewPage new_page)
      : stream_(std::move(socket)), shared_(shared), new_page_(std::move(new_page)) {}

  void read() {
    request_ = {};
    stream_.expires_after(std::chrono::seconds(30));
    http::async_read(stream_, buffer_, request_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (!error) self->answer();
    });
  }

 private:
  void answer() {
    const std::string host(request_[http::field::host]);
    if (shared_.hosts.count(host_name(host)) == 0) {
      shared_.refuse(Refusal::origin);
      return respond(http::status::forbidden, "text/plain", "This server does not answer to that name (option viewer.hosts).\n");
    }
    const std::string target(request_.target());
    const std::string path = target.substr(0, target.find('?'));
    if (websocket::is_upgrade(request_)) return upgrade(path, host);
    if (request_.method() != http::verb::get && request_.method() != http::verb::head)
      return respond(http::status::method_not_allowed, "text/plain", "GET or HEAD.\n");
    const auto file = shared_.files.find(path);
    if (file != shared_.files.end()) return respond(http::status::ok, file->second.type, file->second.body);
    respond(http::status::not_found, "text/plain",
            shared_.files.empty() ? "softhand-viewer was built without its page (SOFTHAND_VIEWER=OFF, or no npm).\n"
                                  : "There is no such file.\n");
  }

  void upgrade(const std::string& path, const std::string& host) {
    const std::string_view origin = view(request_[http::field::origin]);
    // No browser leaves Origin out; other programs may.
    if (!origin.empty() && origin != "http://" + host && origin != "https://" + host) {
      shared_.refuse(Refusal::origin);
      return respond(http::status::forbidden, "text/plain", "Pages of other sites may not connect.\n");
    }
    if (path != "/stream") return respond(http::status::not_found, "text/plain", "The stream is at /stream.\n");
    if (shared_.pages.load() >= shared_.max_pages)
      return respond(http::status::service_unavailable, "text/plain", "Too many pages are open (option viewer.max_pages).\n");
    stream_.expires_never();
    new_page_(stream_.release_socket())->accept(request_);
  }

  void respond(http::status status, std::string_view type, std::string_view body) {
    auto response = std::make_shared<http::response<http::string_body>>(status, request_.version());
    response->set(http::field::content_type, beast::string_view(type.data(), type.size()));
    response->set(http::field::cache_control, "no-cache");
    response->set("X-Content-Type-Options", "nosniff");
    response->set("Content-Security-Policy",
                  "default-src 'self'; connect-src 'self' ws: wss:; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
                  "frame-ancestors 'self'");
    response->keep_alive(request_.keep_alive());
    if (request_.method() == http::verb::head) {
      response->content_length(body.size());
    } else {
      response->body() = body;
      response->prepare_payload();
    }
    http::async_write(stream_, *response, [self = shared_from_this(), response](beast::error_code error, std::size_t) {
      if (error || !response->keep_alive()) {
        beast::error_code ignored;
        self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
        return;
      }
      self->read();
    });
  }

  beast::tcp_stream stream_;
  Shared& shared_;
  NewPage new_page_;
  beast::flat_buffer buffer_{16384};
  http::request<http::string_body> request_;
};

}  // namespace

class Server::Impl {
 public:
  explicit Impl(const ServerOptions& options) : acceptor_(context_) {
    shared_.files = read_files(options.page);
    shared_.hosts = {"localhost", "127.0.0.1", "[::1]", options.address};
    shared_.hosts.insert(options.hosts.begin(), options.hosts.end());
    shared_.max_pages = options.max_pages;
    listen(options);
    url_ = "http://" + (options.address == "0.0.0.0" ? std::string("localhost") : options.address) + ":" +
           std::to_string(acceptor_.local_endpoint().port());
    accept();
    thread_ = std::thread([this] { context_.run(); });
  }

  ~Impl() {
    context_.stop();
    thread_.join();
  }

  void publish(std::vector<Outgoing>&& frames) {
    asio::post(context_, [this, frames = std::move(frames)] {
      for (const Outgoing& each : frames) {
        if (each.keep == Keep::yes) shared_.kept[{each.type, each.instance}] = each.frame;
        for (const auto& page : pages_) page->offer(each);
      }
      const Nanoseconds at = now();
      for (const auto& page : pages_) page->flush(at);
    });
  }

  const std::string& url() const { return url_; }
  Shared& shared() { return shared_; }

 private:
  void listen(const ServerOptions& options) {
    beast::error_code error;
    const auto address = asio::ip::make_address(options.address, error);
    if (error) throw std::runtime_error("viewer.address: expected an IP address, not '" + options.address + "'");
    const int last = options.port == 0 ? 0 : std::min(65535, options.port + 10);
    for (int port = options.port; port <= last; ++port) {
      const tcp::endpoint endpoint(address, static_cast<std::uint16_t>(port));
      acceptor_.open(endpoint.protocol(), error);
      if (!error) acceptor_.set_option(asio::socket_base::reuse_address(true), error);
      if (!error) acceptor_.bind(endpoint, error);
      if (!error) acceptor_.listen(asio::socket_base::max_listen_connections, error);
      if (!error) return;
      acceptor_.close();
      if (error != asio::error::address_in_use) break;
    }
    throw std::runtime_error("cannot listen on " + options.address + ":" + std::to_string(options.port) + ": " + error.message());
  }

  void accept() {
    acceptor_.async_accept([this](beast::error_code error, tcp::socket socket) {
      if (!error) {
        beast::error_code ignored;
        socket.set_option(tcp::no_delay(true), ignored);
        socket.set_option(asio::socket_base::send_buffer_size(kSendBuffer), ignored);
        std::make_shared<Visitor>(std::move(socket), shared_, [this](tcp::socket&& taken) {
          pages_.push_back(std::make_shared<Page>(std::move(taken), shared_, [this] { count_pages(); }));
          count_pages();
          return pages_.back();
        })->read();
      }
      accept();
    });
  }

  void count_pages() {
    std::erase_if(pages_, [](const auto& page) { return page->gone(); });
    TypeSet shown = 0;
    for (const auto& page : pages_) shown |= page->types();
    shared_.shown.store(shown, std::memory_order_relaxed);
    shared_.pages.store(static_cast<std::uint32_t>(pages_.size()), std::memory_order_relaxed);
  }

  asio::io_context context_{1};
  tcp::acceptor acceptor_;
  Shared shared_;
  std::vector<std::shared_ptr<Page>> pages_;
  std::string url_;
  std::thread thread_;
};

Server::Server(const ServerOptions& options) : impl_(std::make_unique<Impl>(options)) {}
Server::~Server() = default;
const std::string& Server::url() const { return impl_->url(); }
TypeSet Server::shown() const { return impl_->shared().shown.load(std::memory_order_relaxed); }
void Server::publish(std::vector<Outgoing> frames) { impl_->publish(std::move(frames)); }

std::vector<Message> Server::take_messages() {
  const std::lock_guard lock(impl_->shared().mutex);
  return std::exchange(impl_->shared().messages, {});
}

ServerCounters Server::counters() const {
  const Shared& shared = impl_->shared();
  ServerCounters out{shared.pages, shared.bytes_sent, shared.frames_sent, shared.frames_passed_over, {}};
  std::copy(shared.refused.begin(), shared.refused.end(), out.refused.begin());
  return out;
}

}  // namespace softhand::viewer
