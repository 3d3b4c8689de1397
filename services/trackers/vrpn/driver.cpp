#include "device/driver.hpp"

#include "trackers/vrpn/vrpn_options.hpp"

namespace {
using namespace softhand;

DriverChecks check(const VrpnOptions& options) {
  std::string cookie;
  DriverChecks out{check_tcp_server("the VRPN server", options.server, options.port,
                                    "Start the server, or correct `server` and `port`", "", cookie,
                                    [](std::string_view text) { return text.size() >= 24; })};
  if (out[0].is_good)
    out.push_back({cookie.starts_with("vrpn: ver. 07."), "its greeting is '" + cookie.substr(0, 16) + "'",
                   "This driver needs a server of VRPN 7"});
  if (options.left.sensor < 0 && options.right.sensor < 0 && options.head.sensor < 0)
    out.push_back({false, "no sensor is chosen", "Set `left.sensor`, `right.sensor` or `head.sensor`"});
  return out;
}

const RegisterDriver<VrpnOptions> driver{"tracker_vrpn", "trackers of a VRPN server.", check};
}  // namespace
