// `softhand doctor` for drivers whose service is a WebSocket server.
#pragma once

#include <string>

#include "device/driver_check.hpp"
#include "device/websocket_client.hpp"

namespace softhand {

/// A server that accepts WebSocket clients at this path within 1 s. `first`: filled with its first message, of at most
/// `largest` bytes. Empty if it sends none within 1 s.
DriverCheck check_websocket_server(const std::string& what, const WebSocketClient::Server& server, std::size_t largest,
                                   const std::string& advice, std::string& first);

}  // namespace softhand
