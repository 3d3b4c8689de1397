// Section [tracker_leap] of a scene.
#pragma once

#include "runtime/options.hpp"

namespace softhand {

struct LeapOptions {
  std::string source = "websocket";
  std::string server = "127.0.0.1";
  std::int64_t port = 6437;
  std::string library = "/usr/lib/ultraleap-hand-tracking-service/libLeapC.so";
  std::string mounting = "desk";
};
inline void describe(OptionVisitor& v, LeapOptions& o) {
  v.choice("source", o.source, {"websocket", "leapc"},
           "websocket: a service that speaks the WebSocket protocol, version 6. leapc: Ultraleap's library LeapC.");
  v.string("server", o.server, "Numeric address of the WebSocket service.");
  v.integer("port", o.port, "1", {1, 65535}, "TCP port of the WebSocket service.");
  v.string("library", o.library, "Ultraleap's library: a path, or a name that the dynamic linker finds.");
  v.choice("mounting", o.mounting, {"desk", "screen", "headset"},
           "Where the camera is: on a desk, above a screen, or on a headset. Mounts are options of `tracking.input`: "
           "`headset_mount` for a headset, else `desk_mount`.");
}

}  // namespace softhand
