// Section [tracker_webxr] of a scene.
#pragma once

#include "web/listening.hpp"

namespace softhand {

struct WebXrOptions {
  web::Listening listening{.port = 8091};
};

inline void describe(OptionVisitor& v, WebXrOptions& o) { describe(v, o.listening); }

}  // namespace softhand
