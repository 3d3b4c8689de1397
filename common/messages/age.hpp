// The age of a sample. All code that judges a sample by its time gets its age here.
#pragma once

#include <algorithm>
#include <optional>

#include "messages/messages.hpp"

namespace softhand {

/// A time up to this far ahead of the reader's counts as the present, ns. A step that is late on a busy machine reads
/// samples that were taken after its own time.
inline constexpr Nanoseconds kFutureTolerance = 50'000'000;

/// Seconds from `time` to `now`, both on one clock. Never negative. Empty if `time` is in the future.
inline std::optional<double> age_of(Nanoseconds time, Nanoseconds now) {
  if (time > now && time - now > kFutureTolerance) return std::nullopt;
  // Anybody can write a stamp. The difference of two integers could overflow.
  return std::max(0.0, (static_cast<double>(now) - static_cast<double>(time)) * kSecondsPerNanosecond);
}

/// `age_of` in milliseconds for `LoopStatus::input_age_ms`: -1 if there is no sample (`time` 0) or no age.
inline double age_ms_of(Nanoseconds time, Nanoseconds now) {
  const std::optional<double> age = time == 0 ? std::nullopt : age_of(time, now);
  return age ? *age * 1e3 : -1;
}

/// A less certain offset of another host's clock counts as unknown, s. It is half of the tolerance, so that no sample
/// seems to be of the future.
inline constexpr double kMostClockUncertainty = 0.025;
inline bool is_known(const HostClock& clock) {
  return clock.uncertainty >= 0 && clock.uncertainty <= kMostClockUncertainty;
}

/// True if the stamp can be used at `now`, the time of this host. Neither its sample nor its publication is then in the
/// future, and the clock `own_clock` made it. A clock id of 0 stands for this host. The readers of the bus give
/// stamps of other hosts the times of `own_clock`, if its offset is known.
inline bool is_usable(const Stamp& stamp, Nanoseconds now, std::uint32_t own_clock) {
  return (stamp.clock_id == 0 || stamp.clock_id == own_clock) && age_of(stamp.sample_time, now) &&
         age_of(stamp.publish_time, now);
}

}  // namespace softhand
