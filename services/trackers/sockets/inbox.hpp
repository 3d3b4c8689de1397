// Messages from programs and pages that track a hand. They arrive by WebSocket and UDP, and are received in own
// threads.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "messages/messages.hpp"
#include "web/listening.hpp"

namespace softhand {

struct Arrival {
  std::string bytes;
  Nanoseconds time = 0;          ///< receive time
  std::uint64_t connection = 0;  ///< new for each WebSocket connection; 0 = UDP
  bool binary = false;           ///< false for text, and for UDP
};

enum class Transport : bool { websocket, websocket_and_udp };

/// A page is accepted if the host name in its Origin is the one under which it reached this server. The port may
/// differ, because the viewer's page comes from another port. The name must be localhost, the address or one of
/// `hosts`. Programs without Origin are accepted. Thread-safe.
class Inbox {
 public:
  /// Starts listening. UDP uses the same port number as TCP. A WebSocket message above `largest` bytes closes its
  /// connection. A larger datagram is dropped. Throws std::runtime_error with address and port if listening fails.
  Inbox(const web::Listening& listening, Transport transport, std::size_t largest);
  ~Inbox();

  std::uint16_t port() const;
  /// URL of the WebSocket, e.g. ws://127.0.0.1:8091
  std::string url() const;
  /// The messages since the last call, oldest first. Only the newest 64 are kept.
  void take(std::vector<Arrival>& out);

  struct Counters {
    std::uint64_t connections = 0;  ///< open now
    std::uint64_t refused_origin = 0;
    std::uint64_t refused_size = 0;
    std::uint64_t passed_over = 0;  ///< dropped because newer ones arrived before they were taken
  };
  Counters counters() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand
