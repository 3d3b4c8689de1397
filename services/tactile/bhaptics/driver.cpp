#include "device/driver.hpp"

#include "device/device_loop.hpp"
#include "device/websocket_check.hpp"
#include "tactile/bhaptics/bhaptics_options.hpp"
#include "tactile/bhaptics/player_messages.hpp"

namespace {
using namespace softhand;
using Options = DeviceOptions<BhapticsOptions>;

DriverChecks check(const Options& options) {
  const BhapticsOptions& own = options.driver;
  std::string first;
  DriverChecks out{check_websocket_server(
      "the bHaptics Player, messages of version 2,", {own.address, own.port, player_target("softhand_doctor")},
      kLargestPlayerMessage, "Start the Player and forward its port, or correct `address` and `port`", first)};
  if (!out[0].is_good) return out;
  const PlayerReport left = decode_player_report(first, Side::left), right = decode_player_report(first, Side::right);
  if (!left.has_positions) {
    out.push_back({true, "it did not list its devices within 1 s"});
    return out;
  }
  const std::string gloves = std::string(left.is_connected ? " GloveL" : "") + (right.is_connected ? " GloveR" : "");
  out.push_back({!gloves.empty(), gloves.empty() ? "no TactGlove is connected" : "connected:" + gloves,
                 "Pair the glove in the Player"});
  return out;
}

const RegisterDriver<Options> driver{"tactile_bhaptics", "a bHaptics TactGlove, vibration of fingers and wrist.",
                                     check};
}  // namespace
