#include "device/driver.hpp"

#include "trackers/openxr/openxr_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::OpenXrOptions> driver{"tracker_openxr", "headsets with an OpenXR runtime."};
}
