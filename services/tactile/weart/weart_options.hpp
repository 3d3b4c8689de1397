// Section [tactile_weart] of a scene, beside the options of every tactile device.
#pragma once

#include "runtime/options.hpp"

namespace softhand {

struct WeartOptions {
  std::string address = "127.0.0.1";
  std::int64_t port = 13031;
  bool pro = false;
  bool calibrate = true;
  double thumb_abduction = 0.35;
  double full_scale_force = 5;
  double temperature = 0.5;
  std::int64_t texture = 2;
  double texture_volume = 100;
  double full_scale_slip = 0.1;
  double slew = 50;
};
inline void describe(OptionVisitor& v, WeartOptions& o) {
  v.string("address", o.address, "Numeric address of the WEART middleware.");
  v.integer("port", o.port, "1", {1, 65535}, "TCP port of the middleware.");
  v.flag("pro", o.pro, "A TouchDIVER Pro: it acts on all fingers and the palm. Without it: thumb, index, middle.");
  v.flag("calibrate", o.calibrate,
         "Calibrate the tracking of the fingers after each connection. The user opens the hand meanwhile.");
  v.number(
      "thumb_abduction", o.thumb_abduction, "rad", {-0.8, 0.8},
      "Angle of the thumb at its largest abduction, from the middle of its range. Negative if it moves to the wrong "
      "side.");
  v.number("full_scale_force", o.full_scale_force, "N", {0.1, 100},
           "Contact force at which the device pushes with its full force. The device has no newtons.");
  v.number("temperature", o.temperature, "1", {0, 1},
           "Temperature of all objects: 0 cold, 0.5 neutral, 1 warm. The simulation has no temperatures.");
  v.integer("texture", o.texture, "1", {0, 21}, "Number of the texture that all objects have.");
  v.number("texture_volume", o.texture_volume, "%", {0, 100}, "Strength of the texture. 0 = no texture.");
  v.number("full_scale_slip", o.full_scale_slip, "m/s", {0.001, 10},
           "Speed of slip at which the texture has its full speed.");
  v.number("slew", o.slew, "1/s", {1, 1000}, "Largest rate of change of an effect, of full scale.");
}

}  // namespace softhand
