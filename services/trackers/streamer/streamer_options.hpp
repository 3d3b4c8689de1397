// Section [tracker_streamer] of a scene.
#pragma once

#include "runtime/options.hpp"

namespace softhand {

struct StreamerOptions {
  std::string address = "127.0.0.1";
  std::int64_t udp_port = 9000;
  std::int64_t tcp_port = 8000;
};
inline void describe(OptionVisitor& v, StreamerOptions& o) {
  v.string("address", o.address,
           "Numeric address to listen on. 127.0.0.1: a headset on a cable (`adb reverse`). 0.0.0.0: every network of "
           "this machine, for a headset on Wi-Fi.");
  v.integer("udp_port", o.udp_port, "1", {0, 65535}, "UDP port. 0 = any free port, printed at the start.");
  v.integer("tcp_port", o.tcp_port, "1", {0, 65535}, "TCP port. 0 = any free port, printed at the start.");
}

}  // namespace softhand
