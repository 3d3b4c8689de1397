// HTTP and WebSocket, with or without TLS, in a thread of its own: what browsers meet. Boost.Beast is seen by
// web_server.cpp alone.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "web/listening.hpp"

namespace softhand::web {

/// Whose pages may open a WebSocket. Programs, which send no Origin, may anyway.
enum class Origin {
  here,       ///< served by this very server
  this_host,  ///< served under the host name by which the server is reached, from whatever port
};

using Bytes = std::shared_ptr<const std::vector<std::uint8_t>>;

/// The server's end of a WebSocket. Of the server's thread, as all of `Session`.
class Socket {
 public:
  virtual ~Socket() = default;
  /// One binary message made of `parts`. The next one waits for `Session::sent`.
  virtual void send(std::vector<Bytes> parts) = 0;
  /// Ends the connection, after what is on its way, because the other end misbehaved.
  virtual void close() = 0;
};

/// What becomes of one WebSocket.
class Session {
 public:
  virtual ~Session() = default;
  /// First of all; `socket` lives until `closed` returns.
  virtual void opened(Socket& socket) = 0;
  virtual void received(std::string_view bytes, bool binary) = 0;
  /// The message that was sent last has left; its size.
  virtual void sent(std::size_t bytes) = 0;
  /// Last of all. `too_large`: because of a message beyond `Site::largest_message`.
  virtual void closed(bool too_large) = 0;
};

struct Answer {
  unsigned status = 404;
  std::string_view type = "text/plain";
  std::string_view body = "There is no such file.\n";
};

/// What is served. Functions are called by the server's thread.
struct Site {
  std::function<Answer(const std::string& path)> get;  ///< what the views show outlives the server
  std::string socket_path;                             ///< where WebSockets are opened; empty = anywhere
  Origin origin = Origin::here;
  std::size_t largest_message = 4096;                 ///< bytes
  std::function<std::shared_ptr<Session>()> connect;  ///< null = too many are open
  std::function<void()> refused;                      ///< a request for another host, or a WebSocket of another origin
};

/// Believes a request only where its Host is localhost, the address or one of `hosts`, and a WebSocket only where its
/// Origin fits, too: so neither other sites nor other names that lead here get in. With a certificate the one port
/// speaks https to all, and http to localhost; who asks it for http under another name is sent to https.
class WebServer {
 public:
  /// Listens from here on. `ports`: so many are tried, one after another, while they are taken. Throws
  /// std::runtime_error naming address and port, or the file, where that is refused.
  WebServer(const Listening& listening, Site site, int ports = 1);
  ~WebServer();

  std::uint16_t port() const;
  /// Where it is reached, e.g. http://127.0.0.1:8080
  const std::string& url() const;
  /// Where other machines reach it: one a name of `hosts` where it listens on 0.0.0.0 or ::, else none.
  const std::vector<std::string>& urls_elsewhere() const;
  /// Has the server's thread do something.
  void post(std::function<void()> work);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand::web
