#include "device/driver.hpp"

#include "device/device_loop.hpp"
#include "haptics/opengloves/opengloves_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::DeviceOptions<softhand::OpenGlovesOptions>> driver{
    "haptic_opengloves", "a LucidGloves or SenseShift glove, fingers and brakes."};
}
