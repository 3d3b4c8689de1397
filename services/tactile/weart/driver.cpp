#include "device/driver.hpp"

#include "device/device_loop.hpp"
#include "tactile/weart/weart_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::DeviceOptions<softhand::WeartOptions>> driver{
    "tactile_weart", "a WEART TouchDIVER, fingers, force, temperature and texture."};
}
