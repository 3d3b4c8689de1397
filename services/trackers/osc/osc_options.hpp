// Section [tracker_osc] of a scene.
#pragma once

#include "runtime/options.hpp"

namespace softhand {

struct OscOptions {
  std::string address = "127.0.0.1";
  std::int64_t port = 39539;
  std::int64_t left_tracker = 0;
  std::int64_t right_tracker = 0;
};
inline void describe(OptionVisitor& v, OscOptions& o) {
  v.string("address", o.address,
           "Numeric address to listen on. 127.0.0.1: only this machine. 0.0.0.0: every network of this machine.");
  v.integer("port", o.port, "1", {0, 65535}, "UDP port. 0 = any free port, printed at the start.");
  v.integer("left_tracker", o.left_tracker, "1", {0, 8},
            "Number of the OSC tracker on the left wrist (/tracking/trackers/N). 0 = none.");
  v.integer("right_tracker", o.right_tracker, "1", {0, 8}, "The same for the right wrist.");
}

}  // namespace softhand
