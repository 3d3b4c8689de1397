// A WebSocket server in place of the service of a device: for simulators and tests.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace softhand {

class SimulatedService {
 public:
  /// The functions run in the thread of the service. They may be null. An empty text is not sent.
  struct Behaviour {
    std::function<std::string(const std::string& target)> opened;     ///< returns the first message of a connection
    std::function<std::string(const std::string& message)> received;  ///< returns the answer to a message
    std::function<void()> closed;                                     ///< a client left
  };
  /// Listens on 127.0.0.1. Port 0 is any free port. Throws std::runtime_error if the port is in use.
  SimulatedService(std::int64_t port, Behaviour behaviour);
  /// Cuts all connections, as a power cut does.
  ~SimulatedService();
  std::uint16_t port() const;
  /// Sends a message to all clients.
  void send(std::string text);

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand
