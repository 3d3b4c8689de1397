// A pad of nine pins on the index fingertip. Each pin presses and moves across the skin. Packets: UDP, 27 little-endian
// floats (N), for each pin along the finger, across it, and into the skin.
#pragma once

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include "device/device_loop.hpp"
#include "device/taxel_map.hpp"

namespace softhand {

struct SamplePadOptions {
  std::int64_t port = 8095;
  double pitch = 0.003;
  double maximum_force = 1;
};
inline void describe(OptionVisitor& v, SamplePadOptions& o) {
  v.integer("port", o.port, "1", {1, 65535}, "UDP port of the pad on this machine.");
  v.number("pitch", o.pitch, "m", {0.001, 0.01}, "Distance of two pins.");
  v.number("maximum_force", o.maximum_force, "N", {0.1, 5}, "Largest force of a pin in each direction.");
}

class SamplePad final : public TactileDriver {
 public:
  using Options = SamplePadOptions;
  SamplePad(const Options& options, const HandModel& hand)
      : options_(options),
        taxels_(hand, fingertip_grid(hand, Finger::index, 3, 3, options.pitch)),
        socket_(socket(AF_INET, SOCK_DGRAM, 0)) {
    pad_.sin_family = AF_INET;
    pad_.sin_port = htons(static_cast<std::uint16_t>(options.port));
    pad_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  }
  ~SamplePad() override { close(socket_); }

  DeviceLimits limits() const override { return {kValues, -options_.maximum_force, options_.maximum_force, 100}; }
  void command(const SkinTraction& input, std::span<double> requested) override {
    std::size_t i = 0;
    for (const TaxelTouch& touch : taxels_.feel(input)) {
      requested[i++] = touch.force[0];
      requested[i++] = touch.force[1];
      requested[i++] = -touch.force[2];
    }
  }
  void write(Nanoseconds, std::span<const double> commands) override {
    std::array<float, kValues> packet;
    std::copy(commands.begin(), commands.end(), packet.begin());
    sendto(socket_, packet.data(), sizeof packet, MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&pad_), sizeof pad_);
  }
  bool release() override {
    write(0, std::array<double, kValues>{});
    return true;
  }

 private:
  static constexpr std::size_t kValues = 27;

  Options options_;
  TaxelMap taxels_;
  int socket_;
  sockaddr_in pad_{};
};

}  // namespace softhand
