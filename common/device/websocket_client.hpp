// Exchanges messages with a device whose service is a WebSocket server, in its own thread, and connects again when the
// service comes back. The counterpart of Intake. Only websocket_client.cpp includes Boost.Beast.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "device/arrival_queue.hpp"
#include "device/intake.hpp"
#include "messages/messages.hpp"

namespace softhand {

class WebSocketClient {
 public:
  struct Server {
    std::string address;  ///< numeric, e.g. 127.0.0.1
    std::int64_t port = 0;
    std::string target = "/";             ///< path and query
    std::vector<std::string> greeting{};  ///< text messages that each new connection sends first
  };
  /// `largest`: bytes of a message. A larger one closes the connection and counts as refused_size. `slots`: messages
  /// that can wait for `take`. Throws std::invalid_argument if the address is not numeric.
  WebSocketClient(const Server& server, std::size_t largest, std::size_t slots = Intake::kDefaultSlots);
  /// Waits up to 50 ms for the last message of `send`.
  ~WebSocketClient();

  /// See Translate. Call it before `start`.
  void translate(Translate translate);
  /// Starts the thread. It connects now, or when the service appears: see Backoff.
  void start();

  /// Calls f(const Arrival&) for each message since the last call, oldest first. Does not block or allocate.
  template <typename F>
  void take(F&& f) {
    queue().take(std::forward<F>(f));
  }
  /// Sends a text message of at most `largest` bytes. For a service that does not take its bytes in time only the
  /// newest message waits. Without a connection the message is dropped. Does not block or allocate. One thread may call
  /// it.
  void send(std::string_view text);
  bool connected() const;
  /// refused_cut is 0.
  Intake::Counters counters() const;
  /// Adds passed_over, superseded, connections and reconnects. refused_size belongs to the decoder's refusals. Does not
  /// allocate.
  void fill_status(LoopStatus& status) const;

 private:
  class Impl;
  ArrivalQueue& queue();
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand
