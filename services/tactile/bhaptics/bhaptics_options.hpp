// Section [tactile_bhaptics] of a scene, beside the options of every tactile device.
#pragma once

#include "runtime/options.hpp"

namespace softhand {

struct BhapticsOptions {
  std::string address = "127.0.0.1";
  std::int64_t port = 15881;
  double full_scale_force = 5;
  double slew = 50;
};
inline void describe(OptionVisitor& v, BhapticsOptions& o) {
  v.string("address", o.address, "Numeric address of the bHaptics Player.");
  v.integer("port", o.port, "1", {1, 65535}, "Port of its messages of version 2.");
  v.number("full_scale_force", o.full_scale_force, "N", {0.1, 100},
           "Contact force on a finger at which its motor has the full intensity.");
  v.number("slew", o.slew, "1/s", {1, 1000}, "Largest rate of change of an intensity, of full scale.");
}

}  // namespace softhand
