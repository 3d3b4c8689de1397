#include "device/driver.hpp"

#include "trackers/leap/leap_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::LeapOptions> driver{"tracker_leap", "Ultraleap's hand tracking cameras."};
}
