#include "device/driver.hpp"

#include "trackers/webxr/webxr_options.hpp"

namespace {
using namespace softhand;

DriverChecks check(const WebXrOptions& options) { return web::checks(options.listening); }

const RegisterDriver<WebXrOptions> driver{"tracker_webxr", "a headset's browser.", check};
}  // namespace
