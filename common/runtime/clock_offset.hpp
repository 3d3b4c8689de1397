// Offset of another host's clock, from messages in both directions. Plain values, no clock and no network.
//
// A message cannot arrive before it was sent. So each message towards us bounds the offset from above, and each message
// away from us bounds it from below: these are the four stamps of an exchange. Within a window of some seconds the
// offset is a straight line in time. The estimate is the middle of all lines that satisfy all bounds, and its
// uncertainty is half of their spread. No assumption is made about delays: they may differ in both directions. If the
// rate of a clock changes by 100 ppm at once, the error exceeds the uncertainty by up to 0.3 ms for some seconds.
#pragma once

#include <array>
#include <cstddef>
#include <optional>

#include "messages/messages.hpp"

namespace softhand {

class ClockOffset {
 public:
  /// Times beyond this are not used, so that differences of stamps do not overflow, ns.
  static constexpr Nanoseconds kLatest = 4'000'000'000'000'000'000;

  struct Estimate {
    Nanoseconds offset = 0;  ///< our time = their time + offset
    double uncertainty = 0;  ///< s; the true offset is within +- this
    double drift = 0;        ///< s/s, growth of the offset
  };

  /// A message from there: sent at their time `sent`, received at our time `received`.
  void heard(Nanoseconds sent, Nanoseconds received);
  /// A message from here: sent at our time `sent`, received at their time `received`.
  void answered(Nanoseconds sent, Nanoseconds received);
  /// The offset at our time `now`. Empty until there is a bound of each kind.
  std::optional<Estimate> at(Nanoseconds now);

 private:
  // The tightest bound of a slice of time.
  struct Bound {
    Nanoseconds time = 0;  // ours
    Nanoseconds offset = 0;
    bool any = false;
  };
  struct Slice {
    std::int64_t number = -1;
    Bound above, below;
  };
  Slice& slice_at(Nanoseconds time);

  static constexpr std::size_t kSlices = 32;
  std::array<Slice, kSlices> slices_{};  // a ring by number
};

}  // namespace softhand
