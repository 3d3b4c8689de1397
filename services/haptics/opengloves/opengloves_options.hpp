// Section [haptic_opengloves] of a scene, beside the options of every haptic device.
#pragma once

#include "runtime/options.hpp"

namespace softhand {

struct OpenGlovesOptions {
  std::string serial;
  std::int64_t baud = 115200;
  std::string address = "127.0.0.1";
  std::int64_t port = 65432;
  std::int64_t maximum = 4095;
  double splay_angle = 0.349;
  double blocking_force = 8;
  std::int64_t force_maximum = 1000;
  double slew = 400;
};
inline void describe(OptionVisitor& v, OpenGlovesOptions& o) {
  v.string("serial", o.serial,
           "Serial port of the glove: /dev/ttyUSB0 on a cable, /dev/rfcomm0 over Bluetooth. Empty = listen to TCP.");
  v.integer("baud", o.baud, "1/s", {9600, 1000000}, "Baud rate of the serial port.");
  v.string("address", o.address,
           "Without a serial port: numeric address to listen on. 127.0.0.1: only this machine. 0.0.0.0: every network "
           "of this machine, for a glove on Wi-Fi.");
  v.integer("port", o.port, "1", {0, 65535}, "TCP port. 0 = any free port, printed at the start.");
  v.integer("maximum", o.maximum, "1", {1, 65535},
            "Largest value of the glove's analog inputs: 4095 with an ESP32, 1023 with an AVR.");
  v.number("splay_angle", o.splay_angle, "rad", {-0.8, 0.8},
           "Angle of a finger at its largest splay, towards the thumb. Negative if the glove counts to the other side: "
           "the protocol does not say it.");
  v.number("blocking_force", o.blocking_force, "N", {0.1, 20}, "Force at which the glove blocks a finger.");
  v.integer("force_maximum", o.force_maximum, "1", {1, 65535},
            "Number that blocks a finger: 1000 for LucidGloves, 4095 for SenseShift.");
  v.number("slew", o.slew, "N/s", {1, 100000}, "Largest rate of change of a force.");
}

}  // namespace softhand
