// Messages from programs and pages that track a hand. They arrive by WebSocket and UDP, and are received in own
// threads.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "device/intake.hpp"
#include "web/listening.hpp"

namespace softhand {

enum class Transport : bool { websocket, websocket_and_udp };

/// A page is accepted if the host name in its Origin is the one under which it reached this server. The port may
/// differ, because the viewer's page comes from another port. The name must be localhost, the address or one of
/// `hosts`. Programs without Origin are accepted.
class Inbox {
 public:
  /// Starts listening. UDP uses the same port number as TCP. A WebSocket message above `largest` bytes closes its
  /// connection. A larger datagram is dropped. `make_translate`: makes the `Translate` of each kind of message, because
  /// each kind has its own thread. Throws std::runtime_error with address and port if listening fails.
  Inbox(const web::Listening& listening, Transport transport, std::size_t largest,
        const std::function<Translate()>& make_translate = {});
  ~Inbox();

  std::uint16_t port() const;
  /// URL of the WebSocket, e.g. ws://127.0.0.1:8091
  std::string url() const;
  /// Calls f(const Arrival&) for each message since the last call: those by WebSocket, oldest first, then those by UDP.
  /// Does not block or allocate. At most 64 of each kind wait.
  template <typename F>
  void take(F&& f) {
    messages().take(f);
    if (Intake* intake = datagrams()) intake->take(f);
  }

  struct Counters {
    std::uint64_t connections = 0;  ///< open now
    std::uint64_t refused_origin = 0;
    std::uint64_t refused_connections = 0;  ///< beyond 16 of programs of this machine, or 16 of others
    std::uint64_t refused_size = 0;
    std::uint64_t passed_over = 0;  ///< dropped because they were not taken in time
  };
  Counters counters() const;
  /// Adds the counters to a status, except refused_size (device/refusals.hpp).
  void fill_status(LoopStatus& status) const;

 private:
  class Impl;
  ArrivalQueue& messages();
  Intake* datagrams();  // null without UDP
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand
