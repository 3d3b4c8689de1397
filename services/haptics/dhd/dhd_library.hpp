// The DHD library of Force Dimension, loaded at run time.
#pragma once

#include <string>

#include "device/shared_library.hpp"

namespace softhand {

/// The functions that the driver and its checks call. All return a negative number on an error.
class DhdLibrary {
 public:
  explicit DhdLibrary(const std::string& path) : library_(path) {
    library_.find("dhdGetDeviceCount", device_count);
    library_.find("dhdOpen", open);
    library_.find("dhdOpenID", open_id);
    library_.find("dhdClose", close);
    library_.find("dhdEnableForce", enable_force);
    library_.find("dhdSetGravityCompensation", set_gravity_compensation);
    library_.find("dhdGetPosition", get_position);
    library_.find("dhdSetForce", set_force);
    library_.find("dhdErrorGetLastStr", last_error);
  }

  int (*device_count)();
  int (*open)();
  int (*open_id)(char index);
  int (*close)(char id);
  int (*enable_force)(unsigned char enable, char id);
  int (*set_gravity_compensation)(int enable, char id);
  int (*get_position)(double* x, double* y, double* z, char id);
  int (*set_force)(double x, double y, double z, char id);
  const char* (*last_error)();

 private:
  SharedLibrary library_;
};

}  // namespace softhand
