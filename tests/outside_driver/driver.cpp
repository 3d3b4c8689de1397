#include "device/driver.hpp"

#include "device/websocket_check.hpp"
#include "outside_options.hpp"

namespace {
using namespace softhand;

DriverChecks check(const OutsideOptions&) {
  std::string first;
  return {check_websocket_server("the service", {"127.0.0.1", 1}, 100, "Start the service", first)};
}

const RegisterDriver<OutsideOptions> driver{"tracker_outside", "a wrist that does not move.", check};
}  // namespace
