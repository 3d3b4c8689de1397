#include "device/driver.hpp"

#include "device/device_loop.hpp"
#include "haptics/openhaptics/openhaptics_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::DeviceOptions<softhand::OpenHapticsOptions>> driver{
    "haptic_openhaptics", "a Touch or Phantom of 3D Systems, cursor and forces."};
}
