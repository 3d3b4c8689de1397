#include "device/driver.hpp"

#include "sample_glove.hpp"

namespace {
const softhand::RegisterDriver<softhand::DeviceOptions<softhand::SampleGloveOptions>> driver{
    "haptic_sample", "the sample of docs/add-a-device.md."};
}
