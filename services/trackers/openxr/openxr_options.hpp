// Section [tracker_openxr] of a scene.
#pragma once

#include "runtime/options.hpp"

namespace softhand {

struct OpenXrOptions {
  double rate = 90;
  std::string space = "stage";
};
inline void describe(OptionVisitor& v, OpenXrOptions& o) {
  v.number("rate", o.rate, "Hz", {1, 1000}, "How often the runtime is asked for the hands.");
  v.choice("space", o.space, {"stage", "local"},
           "The space that becomes the world. stage: its origin is on the floor. local: near the head at the start. A "
           "runtime without a stage gives local.");
}

}  // namespace softhand
