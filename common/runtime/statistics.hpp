// Quantiles and rate of the last second, without allocation: what a loop says about itself in LoopStatus.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "messages/messages.hpp"

namespace softhand {

/// Histogram of durations over a window of one second that rolls on in tenths. Buckets are log-spaced, 32 an octave: a
/// quantile is exact to 1.6 % from 32 ns to 18 minutes. `add` costs a few nanoseconds; about 50 kB.
class RollingHistogram {
 public:
  /// `time` never falls from call to call; a negative duration counts as 0.
  void add(Nanoseconds time, Nanoseconds duration);
  /// Forgets what is older than a second at `time`. Call it before asking, where nothing may have been added for long.
  void expire(Nanoseconds time);

  /// The smallest duration that at least the fraction `p` in (0, 1] of the window's do not exceed; 0 without any.
  Nanoseconds quantile(double p) const;
  std::uint64_t count() const { return count_; }
  /// Additions per second, from the first to the last of the window; 0 with fewer than two.
  double rate() const;

 private:
  static constexpr int kSubBits = 5;
  static constexpr int kLargestBits = 40;
  static constexpr std::size_t kBuckets = (kLargestBits - kSubBits + 1) << kSubBits;
  static constexpr std::size_t kSlots = 10;
  static constexpr Nanoseconds kSlotLength = 100'000'000;

  static std::size_t bucket_of(Nanoseconds duration);
  static Nanoseconds middle_of(std::size_t bucket);

  struct Slot {
    std::array<std::uint32_t, kBuckets> counts{};
    std::uint64_t count = 0;
    Nanoseconds first = 0;
  };
  std::array<Slot, kSlots> slots_{};
  std::array<std::uint64_t, kBuckets> totals_{};
  std::uint64_t count_ = 0;
  Nanoseconds slot_number_ = 0;  // of the newest slot, in tenths of a second of the clock
  Nanoseconds last_ = 0;
};

}  // namespace softhand
