// Stamps of the samples of both hands and a head.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "messages/messages.hpp"

namespace softhand {

class SampleStamps {
 public:
  static constexpr std::size_t kHead = 2;  ///< the track after those of the left and the right hand

  /// Counts a sample. `time` is its time on our clock. Samples with equal or earlier times get ascending ones, a
  /// nanosecond apart.
  void stamp(std::size_t track, Nanoseconds time, Stamp& out) {
    last_[track] = std::max(last_[track] + 1, time);
    out.sample_time = last_[track];
    out.sequence = ++sequence_[track];
  }

 private:
  std::array<Nanoseconds, 3> last_{};
  std::array<std::uint64_t, 3> sequence_{};
};

}  // namespace softhand
