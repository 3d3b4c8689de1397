// Times of a sender's clock on ours: the least delayed of the recent messages tells the offset of the clocks.
#pragma once

#include <algorithm>
#include <limits>

#include "messages/messages.hpp"

namespace softhand {

/// arrival = sent + offset + delay with delay >= 0, so the least difference of the recent messages is the offset plus
/// the shortest delay: mapped times are late by that (a cable's or a radio's, 0.1 to 3 ms). Two windows of 10 s each,
/// so that drift is followed.
class ClockMapping {
 public:
  /// `sent` on the sender's clock, `arrival` on ours. Whether that clock started anew.
  bool add(Nanoseconds sent, Nanoseconds arrival) {
    // No delay is that long.
    const bool anew = least_ != kNone && arrival - sent > std::min(least_, before_) + kLongestDelay;
    if (anew) *this = {};
    if (window_start_ == 0 || arrival - window_start_ > kWindow) {
      // After a silence the window before is none of the recent past: clocks have drifted meanwhile.
      before_ = arrival - window_start_ > 2 * kWindow ? kNone : least_;
      least_ = kNone;
      window_start_ = arrival;
    }
    least_ = std::min(least_, arrival - sent);
    return anew;
  }
  /// After one `add` or more.
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
