#include "device/driver.hpp"

#include "trackers/osc/osc_options.hpp"

namespace {
const softhand::RegisterDriver<softhand::OscOptions> driver{"tracker_osc", "senders of VMC and of OSC trackers."};
}
