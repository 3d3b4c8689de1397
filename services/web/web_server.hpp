// HTTP and WebSocket server for browsers, with or without TLS, in its own thread. Only web_server.cpp includes
// Boost.Beast.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "web/listening.hpp"

namespace softhand::web {

/// The pages that may open a WebSocket. Programs without Origin always may.
enum class Origin {
  here,       ///< pages of this server
  this_host,  ///< pages from the host name under which this server is reached, with any port
};

using Bytes = std::shared_ptr<const std::vector<std::uint8_t>>;

/// The server's end of a WebSocket. Use it in the server's thread only, like `Session`.
class Socket {
 public:
  virtual ~Socket() = default;
  /// Sends one binary message made of `parts`. Wait for `Session::sent` before the next one.
  virtual void send(std::vector<Bytes> parts) = 0;
  /// Closes the connection after the message in progress, because the other end misbehaved.
  virtual void close() = 0;
};

/// Callbacks of one WebSocket.
class Session {
 public:
  virtual ~Session() = default;
  /// The first call. `socket` is valid until `closed` returns.
  virtual void opened(Socket& socket) = 0;
  virtual void received(std::string_view bytes, bool binary) = 0;
  /// The last message has been sent. `bytes` is its size.
  virtual void sent(std::size_t bytes) = 0;
  /// The last call. `too_large`: closed because of a message above `Site::largest_message`.
  virtual void closed(bool too_large) = 0;
};

struct Answer {
  unsigned status = 404;
  std::string_view type = "text/plain";
  std::string_view body = "There is no such file.\n";
};

/// The content of a server. The server's thread calls the functions.
struct Site {
  std::function<Answer(const std::string& path)> get;  ///< the texts behind the views must outlive the server
  std::string socket_path;                             ///< path of the WebSocket; empty = any path
  Origin origin = Origin::here;
  std::size_t largest_message = 4096;  ///< bytes
  /// Largest number of connections from programs of this machine, and of connections from other machines. More are
  /// closed at once.
  std::size_t most_connections = 64;
  /// Sessions can control something. Then programs of other machines need a token for it (`Listening::token`).
  bool controls = false;
  /// Null = too many WebSockets. `trusted`: the other end is a program of this machine, or it knows the token.
  std::function<std::shared_ptr<Session>(bool trusted)> connect;
  std::function<void()> refused;  ///< called for a request with an unknown host, or a WebSocket of
                                  ///< a refused origin
};

/// Accepts a request only if its Host is localhost, the address or one of `hosts`. Accepts a WebSocket only if its
/// Origin fits, too. This keeps out other sites, and other names that resolve to this machine. With a certificate the
/// same port serves https to all, and http to programs of this machine under the name localhost. Other http requests
/// are redirected to https. Whether a program is of this machine follows from its address: it is a loopback address.
class WebServer {
 public:
  /// Starts listening. `ports`: number of ports to try, one after another, while they are in use. Throws
  /// std::runtime_error with address and port, or with the file, if this fails.
  WebServer(const Listening& listening, Site site, int ports = 1);
  ~WebServer();

  std::uint16_t port() const;
  /// URL for this machine, e.g. http://127.0.0.1:8080
  const std::string& url() const;
  /// URLs for other machines: one for each name of `hosts` if the server listens on 0.0.0.0 or ::. Otherwise empty.
  /// They end with the token if there is one.
  const std::vector<std::string>& urls_elsewhere() const;
  /// Runs `work` in the server's thread.
  void post(std::function<void()> work);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand::web
