#include "device/driver.hpp"

#include "trackers/streamer/streamer_options.hpp"

namespace {
using namespace softhand;

DriverChecks check(const StreamerOptions& options) {
  return {check_udp_listening(options.address, options.udp_port),
          check_tcp_listening(options.address, options.tcp_port)};
}

const RegisterDriver<StreamerOptions> driver{"tracker_streamer", "the app Hand Tracking Streamer on a Quest.", check};
}  // namespace
