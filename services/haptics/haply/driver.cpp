#include "device/driver.hpp"

#include "device/device_loop.hpp"
#include "device/websocket_check.hpp"
#include "haptics/haply/haply_messages.hpp"
#include "haptics/haply/haply_options.hpp"

namespace {
using namespace softhand;
using Options = DeviceOptions<HaplyOptions>;

DriverChecks check(const Options& options) {
  const HaplyOptions& own = options.driver;
  std::string first;
  DriverChecks out{check_websocket_server("the Haply Inverse Service", {own.address, own.port}, kLargestHaplyMessage,
                                          "Start the service, or correct `address` and `port`", first)};
  if (out[0].is_good) {
    const HaplyReport report = decode_haply_report(first, own.device_id);
    const bool is_inventory = report.refusal == HaplyRefusal::none && (report.has_list || report.has_session);
    const char* const version = report.has_session ? "of version 3.5 or later" : "older than version 3.5";
    out.push_back({is_inventory,
                   is_inventory ? std::string("its first message is ") + version
                                : std::string("its first message does not list devices"),
                   "This driver needs the simulation channel of a service of version 3.1 or later"});
    const std::string wanted = own.device_id.empty() ? "no Inverse3" : "no Inverse3 '" + own.device_id + "'";
    if (is_inventory)
      out.push_back({report.has_device,
                     report.has_device ? "Inverse3 '" + std::string(report.device_id.data()) + "' is connected"
                                       : wanted + " is connected",
                     "Connect the device and switch it on, or correct `device_id`"});
  }
  if (own.event_port != 0)
    out.push_back(check_tcp_server("its events", own.address, own.event_port,
                                   "Correct `event_port`. With 0 the driver does not know of safety events"));
  return out;
}

const RegisterDriver<Options> driver{"haptic_haply", "a Haply Inverse3, cursor and forces.", check};
}  // namespace
