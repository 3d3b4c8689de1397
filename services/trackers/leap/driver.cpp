#include "device/driver.hpp"

#include "trackers/leap/leap_options.hpp"

namespace {
using namespace softhand;

DriverChecks check(const LeapOptions& options) {
  if (options.source == "leapc")
    return {check_library(options.library, {"LeapCreateConnection", "LeapPollConnection", "LeapGetNow"},
                          "Install Ultraleap's hand tracking service, or correct `library`")};
  return {check_tcp_server("the WebSocket service", options.server, options.port,
                           "Start the service and connect the camera; or choose source = \"leapc\"")};
}

const RegisterDriver<LeapOptions> driver{"tracker_leap", "Ultraleap's hand tracking cameras.", check};
}  // namespace
