// Section [tracker_outside] of a scene.
#pragma once

#include "runtime/options.hpp"

struct OutsideOptions {
  double height = 1;
};
inline void describe(softhand::OptionVisitor& v, OutsideOptions& o) {
  v.number("height", o.height, "m", {0, 3}, "Height of the wrist.");
}
