#include "device/driver.hpp"

#include "device/device_loop.hpp"
#include "haptics/haply/haply_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::DeviceOptions<softhand::HaplyOptions>> driver{
    "haptic_haply", "a Haply Inverse3, cursor and forces."};
}
