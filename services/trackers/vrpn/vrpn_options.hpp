// Section [tracker_vrpn] of a scene.
#pragma once

#include "device/body_mount.hpp"
#include "runtime/options.hpp"

namespace softhand {

struct VrpnSensorOptions {
  std::string tracker = "Tracker0";
  std::int64_t sensor = -1;
  BodyMount mount;
};
inline void describe(OptionVisitor& v, VrpnSensorOptions& o) {
  v.string("tracker", o.tracker, "Name of the tracker at the server, without @ and the host.");
  v.integer("sensor", o.sensor, "1", {-1, 1'000'000}, "Number of its sensor. -1 = none.");
  describe(v, o.mount);
}

struct VrpnOptions {
  std::string server = "127.0.0.1";
  std::int64_t port = 3883;
  std::string up_axis = "y";
  double scale = 1;
  VrpnSensorOptions left, right, head;
};
inline void describe(OptionVisitor& v, VrpnOptions& o) {
  v.string("server", o.server, "Numeric address of the machine that runs the VRPN server.");
  v.integer("port", o.port, "1", {1, 65535}, "TCP port of the server.");
  v.choice("up_axis", o.up_axis, {"y", "z"}, "The up axis of the server's world. It is not part of the protocol.");
  v.number("scale", o.scale, "m", {1e-6, 1000}, "Length of the server's unit: 0.001 for millimetres.");
  describe_section(v, "left", "A sensor on the left wrist.", o.left);
  describe_section(v, "right", "A sensor on the right wrist.", o.right);
  describe_section(v, "head", "A sensor on the head.", o.head);
}

}  // namespace softhand
