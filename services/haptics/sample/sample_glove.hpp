// A glove with a brake on each finger. Packets: UDP, five little-endian floats (N), thumb first.
#pragma once

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include "device/device_loop.hpp"

namespace softhand {

struct SampleGloveOptions {
  std::int64_t port = 8094;
  double maximum_force = 8;
};
inline void describe(OptionVisitor& v, SampleGloveOptions& o) {
  v.integer("port", o.port, "1", {1, 65535}, "UDP port of the glove on this machine.");
  v.number("maximum_force", o.maximum_force, "N", {0.1, 20}, "Largest force of a brake.");
}

class SampleGlove final : public HapticDriver {
 public:
  using Options = SampleGloveOptions;
  explicit SampleGlove(const Options& options) : options_(options), socket_(socket(AF_INET, SOCK_DGRAM, 0)) {
    glove_.sin_family = AF_INET;
    glove_.sin_port = htons(static_cast<std::uint16_t>(options.port));
    glove_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  }
  ~SampleGlove() override { close(socket_); }

  DeviceLimits limits() const override { return {kFingerCount, 0, options_.maximum_force, 400}; }
  void command(const BoneWrench& input, std::span<double> requested) override {
    add_closing_resistance(input, requested);
  }
  void write(Nanoseconds, std::span<const double> commands) override {
    std::array<float, kFingerCount> packet;
    std::copy(commands.begin(), commands.end(), packet.begin());
    sendto(socket_, packet.data(), sizeof packet, MSG_DONTWAIT, reinterpret_cast<const sockaddr*>(&glove_),
           sizeof glove_);
  }
  bool release() override {
    write(0, std::array<double, kFingerCount>{});
    return true;
  }

 private:
  Options options_;
  int socket_;
  sockaddr_in glove_{};
};

}  // namespace softhand
