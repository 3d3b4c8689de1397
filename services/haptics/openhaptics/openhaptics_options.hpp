// Section [haptic_openhaptics] of a scene, beside the options of every haptic device.
#pragma once

#include "device/grounded_point.hpp"

namespace softhand {

struct OpenHapticsOptions {
  std::string library = "libHD.so";
  std::string device;
  // Limits of a Touch, as in docs/haptic-stability.md.
  GroundedPointOptions point{.maximum_force = 3.3, .slew = 1000, .stiffness = 400, .damping = 4};
};
inline void describe(OptionVisitor& v, OpenHapticsOptions& o) {
  v.string("library", o.library, "The HD library of OpenHaptics: a path, or a name that the loader finds.");
  v.string("device", o.device, "Name of the device in the settings of its driver. Empty = the default device.");
  describe(v, o.point);
}

}  // namespace softhand
