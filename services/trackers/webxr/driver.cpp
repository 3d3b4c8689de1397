#include "device/driver.hpp"

#include "trackers/webxr/webxr_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::WebXrOptions> driver{"tracker_webxr", "a headset's browser."};
}
