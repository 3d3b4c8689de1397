// Section [tracker_natnet] of a scene.
#pragma once

#include "device/body_mount.hpp"
#include "runtime/options.hpp"

namespace softhand {

struct NatNetBodyOptions {
  std::int64_t body = 0;
  BodyMount mount;
};
inline void describe(OptionVisitor& v, NatNetBodyOptions& o) {
  v.integer("body", o.body, "1", {0, 0x7fffffff}, "Streaming ID of the rigid body, as in Motive. 0 = none.");
  describe(v, o.mount);
}

struct NatNetOptions {
  std::string server = "127.0.0.1";
  std::int64_t command_port = 1510;
  bool multicast = false;
  std::string group = "239.255.42.99";
  std::int64_t data_port = 1511;
  std::string network = "0.0.0.0";
  std::string up_axis = "y";
  std::string bones = "global";
  std::string skeleton;
  NatNetBodyOptions left, right, head;
};
inline void describe(OptionVisitor& v, NatNetOptions& o) {
  v.string("server", o.server, "Numeric address of the machine that runs Motive.");
  v.integer("command_port", o.command_port, "1", {1, 65535}, "Motive's command port (UDP).");
  v.flag("multicast", o.multicast, "Motive's transmission type: true for multicast, false for unicast.");
  v.string("group", o.group, "Motive's multicast interface. For multicast only.");
  v.integer("data_port", o.data_port, "1", {1, 65535}, "Motive's data port (UDP). For multicast only.");
  v.string("network", o.network,
           "Numeric address of this machine in Motive's network. 0.0.0.0: the network of the default route. For "
           "multicast only.");
  v.choice("up_axis", o.up_axis, {"y", "z"}, "Motive's up axis. It is not part of the protocol.");
  v.choice("bones", o.bones, {"global", "local"},
           "Motive's setting for the coordinates of a skeleton's bones. It is not part of the protocol.");
  v.string("skeleton", o.skeleton, "Name of the skeleton in Motive whose hands are tracked. Empty: none.");
  describe_section(v, "left", "A rigid body on the left wrist. It replaces the left hand of the skeleton.", o.left);
  describe_section(v, "right", "The same for the right wrist.", o.right);
  describe_section(v, "head", "A rigid body on the head.", o.head);
}

}  // namespace softhand
