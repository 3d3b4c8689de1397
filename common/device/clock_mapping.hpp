// Maps times of a sender's clock to our clock. The recent message with the least delay gives the offset of the clocks.
#pragma once

#include <algorithm>
#include <limits>

#include "messages/messages.hpp"

namespace softhand {

/// Every message satisfies arrival = sent + offset + delay with delay >= 0. The least difference of the recent messages
/// is the offset plus the shortest delay. Mapped times are late by this delay (0.1 to 3 ms on a cable or by radio). Two
/// windows of 10 s each let the offset follow the drift.
class ClockMapping {
 public:
  /// `sent` is on the sender's clock, `arrival` on ours. Returns true if the sender's clock was restarted.
  bool add(Nanoseconds sent, Nanoseconds arrival) {
    // The difference grew by more than any delay, so the sender's clock was restarted.
    const bool restarts = least_ != kNone && arrival - sent > std::min(least_, before_) + kLongestDelay;
    if (restarts) *this = {};
    if (window_start_ == 0 || arrival - window_start_ > kWindow) {
      // After a pause the previous window is too old, because the clocks have drifted since.
      before_ = arrival - window_start_ > 2 * kWindow ? kNone : least_;
      least_ = kNone;
      window_start_ = arrival;
    }
    least_ = std::min(least_, arrival - sent);
    return restarts;
  }
  /// Call `add` at least once before.
  Nanoseconds map(Nanoseconds time) const { return time + std::min(least_, before_); }

 private:
  static constexpr Nanoseconds kWindow = 10'000'000'000;
  static constexpr Nanoseconds kLongestDelay = 2'000'000'000;
  static constexpr Nanoseconds kNone = std::numeric_limits<Nanoseconds>::max();
  Nanoseconds window_start_ = 0;
  Nanoseconds least_ = kNone;
  Nanoseconds before_ = kNone;
};

}  // namespace softhand
