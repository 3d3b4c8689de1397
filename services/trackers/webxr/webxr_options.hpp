// Section [tracker_webxr] of a scene.
#pragma once

#include "trackers/sockets/socket_options.hpp"

namespace softhand {

struct WebXrOptions {
  SocketOptions socket{"127.0.0.1", 8091, ""};
};

inline void describe(OptionVisitor& v, WebXrOptions& o) { describe(v, o.socket); }

}  // namespace softhand
