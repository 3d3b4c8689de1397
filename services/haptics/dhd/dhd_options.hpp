// Section [haptic_dhd] of a scene, beside the options of every haptic device.
#pragma once

#include "device/grounded_point.hpp"

namespace softhand {

struct DhdOptions {
  std::string library = "libdhd.so.3";
  std::int64_t index = -1;
  // The force of a Falcon, the weakest of these devices. Stiffness and damping are a third of what it renders without
  // delay: this driver has one (docs/haptic-stability.md).
  GroundedPointOptions point{.maximum_force = 8, .slew = 1000, .stiffness = 1000, .damping = 10};
};
inline void describe(OptionVisitor& v, DhdOptions& o) {
  v.string("library", o.library, "The library of the Force Dimension SDK: a path, or a name that the loader finds.");
  v.integer("index", o.index, "1", {-1, 15}, "Number of the device, from 0 on. -1 = the first one that is free.");
  describe(v, o.point);
}

}  // namespace softhand
