#include "device/driver.hpp"

#include "trackers/osc/osc_options.hpp"

namespace {
using namespace softhand;

DriverChecks check(const OscOptions& options) { return {check_udp_listening(options.address, options.port)}; }

const RegisterDriver<OscOptions> driver{"tracker_osc", "senders of VMC, of OSC trackers and of plain hands.", check};
}  // namespace
