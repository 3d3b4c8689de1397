#include "device/driver.hpp"

#include "device/device_loop.hpp"
#include "haptics/dhd/dhd_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::DeviceOptions<softhand::DhdOptions>> driver{
    "haptic_dhd", "a Force Dimension device or a Falcon, cursor and forces."};
}
