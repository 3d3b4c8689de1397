#include "device/driver.hpp"

#include "sample_pad.hpp"

namespace {
const softhand::RegisterDriver<softhand::DeviceOptions<softhand::SamplePadOptions>> driver{
    "tactile_sample", "the sample pad of docs/add-a-device.md."};
}
