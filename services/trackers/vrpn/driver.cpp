#include "device/driver.hpp"

#include "trackers/vrpn/vrpn_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::VrpnOptions> driver{"tracker_vrpn", "trackers of a VRPN server."};
}
