#include "device/driver.hpp"

#include "device/device_loop.hpp"
#include "tactile/bhaptics/bhaptics_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::DeviceOptions<softhand::BhapticsOptions>> driver{
    "tactile_bhaptics", "a bHaptics TactGlove, vibration of fingers and wrist."};
}
