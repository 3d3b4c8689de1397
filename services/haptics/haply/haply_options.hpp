// Section [haptic_haply] of a scene, beside the options of every haptic device.
#pragma once

#include "device/grounded_point.hpp"

namespace softhand {

struct HaplyOptions {
  std::string address = "127.0.0.1";
  std::int64_t port = 10001;
  std::int64_t event_port = 10020;
  std::string device_id;
  std::string force_key = "auto";
  // The force is what other clients of the Inverse3 allow. Stiffness and damping are cautious, not measured.
  GroundedPointOptions point{.maximum_force = 2, .slew = 300, .stiffness = 300, .damping = 2};
};
inline void describe(OptionVisitor& v, HaplyOptions& o) {
  v.string("address", o.address, "Numeric address of the Haply Inverse Service.");
  v.integer("port", o.port, "1", {1, 65535}, "Port of its simulation channel, with messages of version 3.1 or later.");
  v.integer("event_port", o.event_port, "1", {0, 65535},
            "Port of its events. After a safety event forces are zero for a while. 0 = no events.");
  v.string("device_id", o.device_id, "Id of the Inverse3, as 049D. Empty = the first one.");
  v.choice("force_key", o.force_key, {"auto", "vector", "values"},
           "Key of a force in the messages to the service. Versions differ, and ignore the other key silently. auto: "
           "by the first message of the service, and the other key if forces have no effect.");
  describe(v, o.point);
}

}  // namespace softhand
