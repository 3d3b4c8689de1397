#include "device/driver.hpp"

#include "trackers/natnet/natnet_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::NatNetOptions> driver{"tracker_natnet", "OptiTrack's Motive (NatNet)."};
}
