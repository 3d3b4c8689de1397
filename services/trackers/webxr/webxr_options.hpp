// Section [tracker_webxr] of a scene.
#pragma once

#include "trackers/sockets/socket_options.hpp"

namespace softhand {

struct WebXrOptions {
  SocketOptions socket = local_socket(8091);
};

inline void describe(OptionVisitor& v, WebXrOptions& o) { describe(v, o.socket); }

}  // namespace softhand
