// Section [tracker_sample] of a scene.
#pragma once

#include "runtime/options.hpp"

namespace softhand {

struct SampleOptions {
  std::string address = "127.0.0.1";
  std::int64_t port = 8093;
};
inline void describe(OptionVisitor& v, SampleOptions& o) {
  v.string("address", o.address, "Numeric address to listen on. 0.0.0.0: all networks of this machine.");
  v.integer("port", o.port, "1", {0, 65535}, "UDP port. 0 = any free port, printed at the start.");
}

}  // namespace softhand
