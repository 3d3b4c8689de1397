#include "runtime/statistics.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace softhand {

// Durations below 2^5 ns have one bucket each. For longer durations, the five bits after the leading bit select the
// bucket within the octave.
std::size_t RollingHistogram::bucket_of(Nanoseconds duration) {
  const auto value =
      std::min(static_cast<std::uint64_t>(std::max<Nanoseconds>(duration, 0)), (std::uint64_t{1} << kLargestBits) - 1);
  const auto bits = static_cast<int>(std::bit_width(value));
  if (bits <= kSubBits) return static_cast<std::size_t>(value);
  const int shift = bits - kSubBits - 1;
  return (static_cast<std::size_t>(shift) << kSubBits) + static_cast<std::size_t>(value >> shift);
}

Nanoseconds RollingHistogram::middle_of(std::size_t bucket) {
  if (bucket < std::size_t{1} << (kSubBits + 1)) return static_cast<Nanoseconds>(bucket);
  const auto shift = static_cast<int>((bucket >> kSubBits) - 1);
  const auto leading = static_cast<Nanoseconds>(bucket - (static_cast<std::size_t>(shift) << kSubBits));
  return (leading << shift) + (Nanoseconds{1} << shift) / 2;
}

void RollingHistogram::expire(Nanoseconds time) {
  const Nanoseconds number = time / kSlotLength;
  const auto outdated = std::min<Nanoseconds>(number - slot_number_, static_cast<Nanoseconds>(kSlots));
  for (Nanoseconds i = 1; i <= outdated; ++i) {
    Slot& slot = slots_[static_cast<std::size_t>((slot_number_ + i) % static_cast<Nanoseconds>(kSlots))];
    if (slot.count == 0) continue;
    for (std::size_t b = 0; b < kBuckets; ++b) totals_[b] -= slot.counts[b];
    count_ -= slot.count;
    slot = Slot{};
  }
  slot_number_ = std::max(slot_number_, number);
}

void RollingHistogram::add(Nanoseconds time, Nanoseconds duration) {
  expire(time);
  Slot& slot = slots_[static_cast<std::size_t>(slot_number_ % static_cast<Nanoseconds>(kSlots))];
  const std::size_t bucket = bucket_of(duration);
  if (slot.count == 0) slot.first = time;
  ++slot.counts[bucket];
  ++slot.count;
  ++totals_[bucket];
  ++count_;
  last_ = time;
}

Nanoseconds RollingHistogram::quantile(double p) const {
  if (count_ == 0) return 0;
  const auto rank =
      std::clamp<std::uint64_t>(static_cast<std::uint64_t>(std::ceil(p * static_cast<double>(count_))), 1, count_);
  std::uint64_t below = 0;
  std::size_t bucket = 0;
  while ((below += totals_[bucket]) < rank) ++bucket;
  return middle_of(bucket);
}

double RollingHistogram::rate() const {
  if (count_ < 2) return 0;
  Nanoseconds first = last_;
  for (const Slot& slot : slots_) {
    if (slot.count > 0) first = std::min(first, slot.first);
  }
  return last_ > first ? static_cast<double>(count_ - 1) * 1e9 / static_cast<double>(last_ - first) : 0;
}

}  // namespace softhand
