// Receives the packets of a device by UDP, TCP or a serial port, in its own thread, and connects again when the device
// comes back. Writes packets to the device on the same connection. Listens to devices, or connects to servers.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "device/arrival_queue.hpp"
#include "device/packet_splitter.hpp"
#include "messages/messages.hpp"

namespace softhand {

class Intake {
 public:
  struct Counters {
    std::uint64_t connections = 0;   ///< open now: TCP connections and serial ports
    std::uint64_t reconnects = 0;    ///< connections that came after the first one was closed
    std::uint64_t refused_size = 0;  ///< packets above the largest size
    std::uint64_t refused_cut = 0;   ///< packets without an end when their connection closed
    std::uint64_t passed_over = 0;   ///< dropped because they were not taken in time
    std::uint64_t superseded = 0;    ///< packets of `send` that a newer one replaced before the device took them
    std::uint64_t refused() const { return refused_size + refused_cut; }
  };

  static constexpr std::size_t kDefaultSlots = 64;
  /// `largest`: bytes of a packet. Larger ones are refused. `slots`: packets that can wait for `take`, for devices that
  /// send many at once.
  explicit Intake(std::size_t largest, std::size_t slots = kDefaultSlots);
  ~Intake();

  /// Any number of these, each before `start`. A packet is a datagram, or the bytes of a stream up to `end`. The
  /// address is numeric. Port 0 is any free port. They return the port. They throw std::runtime_error with address,
  /// port and reason if listening fails.
  std::uint16_t listen_udp(const std::string& address, std::int64_t port);
  /// At most 16 connections. One more closes the oldest.
  std::uint16_t listen_tcp(const std::string& address, std::int64_t port, Framing framing);
  /// Sends datagrams to a server, and receives those of its address, whatever their port.
  void connect_udp(const std::string& address, std::int64_t port);
  /// Receives what the server at `address` sends to a multicast group. `network`: the address of this machine in the
  /// network of the server. 0.0.0.0: the network of the default route. IPv4 only. Other programs may join too.
  void join_udp(const std::string& address, const std::string& group, std::int64_t port, const std::string& network);
  /// Connects to a server, now or when it appears: see Backoff. Each connection first sends the greeting. A stream that
  /// is not of the protocol, by `framing`, is closed, counted as refused_size, and connected again.
  void connect_tcp(const std::string& address, std::int64_t port, Framing framing, const std::string& greeting = "");
  /// Opens the port as 8N1 without flow control, now or when it appears: see Backoff. Throws std::invalid_argument for
  /// a baud rate that termios lacks.
  void open_serial(const std::string& path, std::int64_t baud, Framing framing);
  /// See Translate. Call it before `start`.
  void translate(Translate translate);
  /// The packet of `release`, at most `largest` bytes. Call it before `start`.
  void set_release(std::string bytes);
  /// Starts the thread.
  void start();

  /// Calls f(const Arrival&) for each packet since the last call, oldest first. Does not block or allocate.
  template <typename F>
  void take(F&& f) {
    queue().take(std::forward<F>(f));
  }
  /// Writes a packet of at most `largest` bytes to a connection. 0: to all of them and to the servers of `connect_udp`.
  /// For a device that does not take its bytes in time only the newest packet waits. The destructor waits up to 50 ms
  /// for the last one. Does not block or allocate. One thread may call it.
  void send(std::uint64_t connection, std::string_view bytes);
  /// Writes the packet of `set_release` to all connections, before packets that wait. Any thread may call it, also
  /// beside `send`. Does not block or allocate.
  void release();
  /// False if no packet can arrive now: nothing listens to UDP, and nothing is connected.
  bool connected() const;
  Counters counters() const;
  /// Adds passed_over, and for streams also connections, reconnects and refused_cut. refused_size belongs to the
  /// decoder's refusals (device/refusals.hpp). Does not allocate.
  void fill_status(LoopStatus& status) const;

 private:
  class Impl;
  ArrivalQueue& queue();
  std::unique_ptr<Impl> impl_;
};

}  // namespace softhand
