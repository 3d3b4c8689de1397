// What the fuzzer of flight files shares with its seeds.
#pragma once

#include "flight/tracking_flight.hpp"
#include "fuzz/tracker_fuzzer.hpp"

namespace softhand::fuzz {

/// What the rest of an input is, by its first byte.
enum class FlightPart : std::uint8_t {
  header,
  tracking_step,
  hand_step,
  world_step,
  tracking_snapshot,
  hand_state,
  message,
  object,
  joint,
  result
};

/// The loop that loads snapshots.
inline TrackingLoop& flight_loop() {
  static TrackingLoop loop(TrackingOptions{}, 90, shipped_hand(), HandKey{0, 1});
  return loop;
}

}  // namespace softhand::fuzz
