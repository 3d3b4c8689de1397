// Health of a device: of a tracker from the samples and refusals of its source, of another one from its connection.
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "device/tracker_source.hpp"

namespace softhand {

/// Published as the counter `health` of loop_status.
enum class Health : std::uint8_t {
  opening = 0,   ///< no sample, or no connection, since the start
  live = 1,      ///< samples arrive, or the device is connected
  degraded = 2,  ///< samples arrive, but within the last second one came late or in doubt, or many packets were refused
  lost = 3,      ///< samples arrived, but the device is disconnected or silent now
};
inline constexpr std::array<std::string_view, 4> kHealthNames{"opening", "live", "degraded", "lost"};

/// Largest strength that a user may give a tracker.
inline constexpr int kMostStrength = 999;
/// Strength of a tracker among the writers of a hand: a healthy one is stronger than all that are not.
constexpr int strength_of(int strength, Health health) {
  return strength + (health == Health::opening || health == Health::live ? kMostStrength + 1 : 0);
}

class HealthMonitor {
 public:
  static constexpr Nanoseconds kLate = 100'000'000;      ///< a longer gap between samples degrades
  static constexpr Nanoseconds kSilent = 500'000'000;    ///< after a longer gap the device is lost
  static constexpr Nanoseconds kMemory = 1'000'000'000;  ///< a late sample or a refusal degrades for this time
  static constexpr double kRefusedShare = 0.1;           ///< of the packets of one such time
  static constexpr double kDoubt = 0.3;                  ///< a sample with less confidence degrades

  /// A sample arrived. Confidence 0 says that no hand is seen: the device is well.
  void sample(Nanoseconds now, double confidence = 1);
  /// Call it at least ten times a second.
  Health update(Nanoseconds now, const SourceState& state);

 private:
  Nanoseconds newest_ = 0;
  Nanoseconds degraded_until_ = 0;
  Nanoseconds window_start_ = 0;
  std::uint64_t samples_ = 0;         // in this window
  std::uint64_t refused_before_ = 0;  // count of the source at the start of this window
};

/// Health of a device that sends no samples.
class ConnectionHealth {
 public:
  Health update(bool connected) {
    was_connected_ = was_connected_ || connected;
    return connected ? Health::live : was_connected_ ? Health::lost : Health::opening;
  }

 private:
  bool was_connected_ = false;
};

/// Times between attempts to open a device: 0.1 s, then twice as long each time, at most 5 s.
class Backoff {
 public:
  /// The time to wait before the next attempt.
  Nanoseconds next() {
    const Nanoseconds wait = wait_;
    wait_ = wait * 2 < kLongest ? wait * 2 : kLongest;
    return wait;
  }
  /// The device delivered: the next failure begins with the shortest time.
  void reset() { wait_ = kShortest; }

 private:
  static constexpr Nanoseconds kShortest = 100'000'000, kLongest = 5'000'000'000;
  Nanoseconds wait_ = kShortest;
};

}  // namespace softhand
