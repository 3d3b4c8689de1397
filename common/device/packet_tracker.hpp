// A tracker whose samples come as packets: a receiver takes them from the device, and a decoder makes hands of them.
#pragma once

#include <cstddef>
#include <string_view>
#include <utility>

#include "device/intake.hpp"
#include "device/tracker_source.hpp"

namespace softhand {

/// `Decoder` has take(const Arrival&, TrackerSink&) and refusals(). If it has speak(now, send) too, this is called
/// after the packets, with a function send(std::string_view) that sends a packet to the device. `Receiver` is Intake,
/// WebSocketClient or DeviceThread. A driver's constructor prepares and starts `receiver_`.
template <typename Decoder, typename Receiver = Intake>
class PacketTracker : public TrackerSource {
 public:
  void poll(Nanoseconds now, TrackerSink& out) final {
    receiver_.take([&](const Arrival& packet) { decoder_.take(packet, out); });
    if constexpr (requires { decoder_.speak(now, [](std::string_view) {}); })
      decoder_.speak(now, [this](std::string_view bytes) { receiver_.send(0, bytes); });
  }
  SourceState state() const final {
    return {receiver_.connected(), decoder_.refusals().total() + receiver_.counters().refused()};
  }
  void fill_status(LoopStatus& status) const final {
    receiver_.fill_status(status);
    decoder_.refusals().fill_status(status, receiver_.counters().refused_size);
  }

 protected:
  /// `of_receiver`: the arguments of its constructor.
  template <typename... Arguments>
  explicit PacketTracker(Decoder decoder, Arguments&&... of_receiver)
      : receiver_(std::forward<Arguments>(of_receiver)...), decoder_(std::move(decoder)) {}
  Receiver receiver_;

 private:
  Decoder decoder_;
};

}  // namespace softhand
