#include "device/driver.hpp"

#include "device/device_loop.hpp"
#include "haptics/opengloves/opengloves_options.hpp"

namespace {
using namespace softhand;
using Options = DeviceOptions<OpenGlovesOptions>;

DriverChecks check(const Options& options) {
  const OpenGlovesOptions& own = options.driver;
  return {own.serial.empty() ? check_tcp_listening(own.address, own.port) : check_serial(own.serial)};
}

const RegisterDriver<Options> driver{"haptic_opengloves", "a LucidGloves or SenseShift glove, fingers and brakes.",
                                     check};
}  // namespace
