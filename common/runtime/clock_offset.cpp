#include "runtime/clock_offset.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace softhand {
namespace {

constexpr Nanoseconds kSlice = 500'000'000;
/// Quartz is within 100 ppm. NTP may change the rate of a clock by 500 ppm.
constexpr double kMostDrift = 1e-3;
/// The rate of a clock changes with its temperature, and by NTP. So an old bound says less.
constexpr double kWander = 2e-6;
constexpr double kResolution = 1e-6;  // s, of the stamps and of the sums below

/// One side of the offset at a time, in seconds, as a function of the drift.
struct Line {
  double bound;  // s, from a common base
  double age;    // s
};

template <typename F>
double minimum_of(double low, double high, const F& convex) {
  for (int i = 0; i < 80; ++i) {
    const double a = low + (high - low) / 3, b = high - (high - low) / 3;
    if (convex(a) <= convex(b)) {
      high = b;
    } else {
      low = a;
    }
  }
  return (low + high) / 2;
}

/// The end of the interval in which `is_inside` is true, between a point inside and one outside or at its end.
template <typename F>
double edge_of(double inside, double outside, const F& is_inside) {
  if (is_inside(outside)) return outside;
  for (int i = 0; i < 60; ++i) {
    const double middle = (inside + outside) / 2;
    (is_inside(middle) ? inside : outside) = middle;
  }
  return inside;
}

bool is_time(Nanoseconds time) { return time >= 0 && time <= ClockOffset::kLatest; }

}  // namespace

ClockOffset::Slice& ClockOffset::slice_at(Nanoseconds time) {
  const std::int64_t number = time / kSlice;
  Slice& slice = slices_[static_cast<std::size_t>(number) % kSlices];
  if (slice.number != number) slice = Slice{number, {}, {}};
  return slice;
}

void ClockOffset::heard(Nanoseconds sent, Nanoseconds received) {
  if (!is_time(sent) || !is_time(received)) return;
  Bound& bound = slice_at(received).above;
  if (!bound.any || received - sent < bound.offset) bound = {received, received - sent, true};
}

void ClockOffset::answered(Nanoseconds sent, Nanoseconds received) {
  if (!is_time(sent) || !is_time(received)) return;
  Bound& bound = slice_at(sent).below;
  if (!bound.any || sent - received > bound.offset) bound = {sent, sent - received, true};
}

std::optional<ClockOffset::Estimate> ClockOffset::at(Nanoseconds now) {
  // A clock that was set, or that changed its rate, contradicts older bounds. The oldest slices are then forgotten.
  for (;;) {
    std::array<Line, kSlices> above{}, below{};
    std::size_t above_count = 0, below_count = 0;
    Nanoseconds base = 0;
    Slice* oldest = nullptr;
    for (Slice& slice : slices_) {
      if (slice.number < 0) continue;
      if (oldest == nullptr || slice.number < oldest->number) oldest = &slice;
      if (base == 0) base = slice.above.any ? slice.above.offset : slice.below.offset;
      const auto line = [&](const Bound& bound) {
        return Line{static_cast<double>(bound.offset - base) * 1e-9, static_cast<double>(now - bound.time) * 1e-9};
      };
      if (slice.above.any) above[above_count++] = line(slice.above);
      if (slice.below.any) below[below_count++] = line(slice.below);
    }
    if (above_count == 0 || below_count == 0) return std::nullopt;
    const auto slack = [](const Line& line) { return kResolution + kWander * std::abs(line.age); };
    const auto lowest = [&](double drift) {  // convex
      double most = -std::numeric_limits<double>::infinity();
      for (std::size_t i = 0; i < below_count; ++i)
        most = std::max(most, below[i].bound + drift * below[i].age - slack(below[i]));
      return most;
    };
    const auto highest = [&](double drift) {  // concave
      double least = std::numeric_limits<double>::infinity();
      for (std::size_t i = 0; i < above_count; ++i)
        least = std::min(least, above[i].bound + drift * above[i].age + slack(above[i]));
      return least;
    };
    const auto is_possible = [&](double drift) { return lowest(drift) <= highest(drift); };
    const double best =
        minimum_of(-kMostDrift, kMostDrift, [&](double drift) { return lowest(drift) - highest(drift); });
    if (!is_possible(best)) {
      *oldest = Slice{};
      continue;
    }
    const double slowest = edge_of(best, -kMostDrift, is_possible);
    const double fastest = edge_of(best, kMostDrift, is_possible);
    const double low = lowest(minimum_of(slowest, fastest, lowest));
    const double high = highest(minimum_of(slowest, fastest, [&](double drift) { return -highest(drift); }));
    return Estimate{base + static_cast<Nanoseconds>(std::llround((low + high) / 2 * 1e9)), (high - low) / 2,
                    (slowest + fastest) / 2};
  }
}

}  // namespace softhand
