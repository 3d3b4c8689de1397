#include "device/websocket_check.hpp"

#include <chrono>
#include <thread>

#include "runtime/clock.hpp"

namespace softhand {

DriverCheck check_websocket_server(const std::string& what, const WebSocketClient::Server& server, std::size_t largest,
                                   const std::string& advice, std::string& first) {
  constexpr Nanoseconds kPatience = 1'000'000'000;
  first.clear();
  DriverCheck out = check_tcp_server(what, server.address, server.port, advice);
  if (!out.is_good) return out;
  WebSocketClient client(server, largest);
  client.start();
  bool is_open = false;
  for (const Nanoseconds end = now() + kPatience; first.empty() && now() < end;) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    is_open = is_open || client.connected();
    client.take([&](const Arrival& message) {
      if (first.empty()) first = message.bytes;
    });
  }
  if (!is_open && first.empty())
    return {false, out.found + ", but no WebSocket clients at " + server.target.substr(0, server.target.find('?')),
            advice};
  out.found += " of WebSocket clients";
  return out;
}

}  // namespace softhand
