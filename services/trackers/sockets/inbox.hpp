// Messages from programs and pages that track a hand: WebSocket and UDP, received in threads of their own.
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
  Nanoseconds time = 0;          ///< when it was received
  std::uint64_t connection = 0;  ///< new for each WebSocket connection; 0 = UDP
  bool binary = false;           ///< false for text, and for UDP
};

enum class Transport : bool { websocket, websocket_and_udp };

/// A page is believed where its Origin has the host name that it asked, whatever the port (the viewer's page is served
/// from another), and that is localhost, the address or one of `hosts`. Programs without Origin are believed.
/// Thread-safe.
class Inbox {
 public:
  /// Listens from here on, UDP on the number of the TCP port. Messages above `largest` bytes close their connection, or
  /// are dropped. Throws std::runtime_error naming address and port where that is refused.
  Inbox(const web::Listening& listening, Transport transport, std::size_t largest);
  ~Inbox();

  std::uint16_t port() const;
  /// Of the WebSocket, e.g. ws://127.0.0.1:8091
  std::string url() const;
  /// What arrived since the last call, oldest first; at most the newest 64.
  void take(std::vector<Arrival>& out);

  struct Counters {
    std::uint64_t connections = 0;  ///< open now
    std::uint64_t refused_origin = 0;
    std::uint64_t refused_size = 0;
    std::uint64_t passed_over = 0;  ///< pushed out by newer ones before they were taken
  };
  Counters counters() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand
