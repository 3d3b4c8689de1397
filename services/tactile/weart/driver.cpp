#include "device/driver.hpp"

#include <array>

#include "device/device_loop.hpp"
#include "tactile/weart/weart_messages.hpp"
#include "tactile/weart/weart_options.hpp"

namespace {
using namespace softhand;
using Options = DeviceOptions<WeartOptions>;

// What the answers to our questions say.
struct States {
  bool has_middleware = false, has_devices = false;
  int code = 0;
  std::array<int, 2> gloves{};  // left, right
  std::string version;
};
States read_states(std::string_view answer) {
  States out;
  for (std::size_t end; (end = answer.find(kWeartEnd)) != std::string_view::npos; answer.remove_prefix(end + 1)) {
    const std::string_view message = answer.substr(0, end);
    for (const Side side : {Side::left, Side::right}) {
      const WeartReport report = decode_weart(message, side);
      if (report.kind == WeartKind::middleware) {
        out.has_middleware = true;
        out.code = report.value;
        out.version = weart_version(message);
      } else if (report.kind == WeartKind::devices) {
        out.has_devices = true;
        out.gloves[static_cast<std::size_t>(side)] = report.value;
      }
    }
  }
  return out;
}

// The middleware only answers questions here. Nothing starts.
DriverChecks check(const Options& options) {
  const WeartOptions& own = options.driver;
  std::string answer;
  const auto is_whole = [](std::string_view text) {
    const States states = read_states(text);
    return states.has_middleware && states.has_devices;
  };
  DriverChecks out{check_tcp_server("the WEART middleware", own.address, own.port,
                                    "Start the middleware, or correct `address` and `port`", weart_questions(), answer,
                                    is_whole)};
  if (!out[0].is_good) return out;
  const States states = read_states(answer);
  if (!states.has_middleware) {
    out.push_back({false, "it does not say its state within 1 s",
                   "End other clients of the middleware. Or another program has this port"});
    return out;
  }
  out.push_back({states.code == 0,
                 "it has version " + (states.version.empty() ? "unknown" : states.version) + " and status code " +
                     std::to_string(states.code),
                 "The middleware shows what its status code means"});
  if (states.has_devices)
    out.push_back({states.gloves[0] + states.gloves[1] > 0,
                   "connected devices: " + std::to_string(states.gloves[0]) + " left, " +
                       std::to_string(states.gloves[1]) + " right",
                   "Connect a TouchDIVER in the middleware"});
  return out;
}

const RegisterDriver<Options> driver{"tactile_weart", "a WEART TouchDIVER, fingers, force, temperature and texture.",
                                     check};
}  // namespace
