// Moves the steps of a loop to the moments at which its input arrives.
#pragma once

#include <array>
#include <cstddef>

#include "messages/messages.hpp"

namespace softhand {

/// A loop and its source have almost the same rate, or one rate is a multiple of the other. Without a lock, a sample
/// waits up to a period for the next step. PhaseLock moves the grid of the loop, so that a step starts `margin` after
/// the arrival of a sample.
///
/// It measures how long before each due time the newest sample arrived. Nine of ten samples arrive in time, so jitter
/// costs only its own length. A source without a common phase moves nothing, for example 60 Hz for a loop of 90 Hz.
/// The waits count as angles in the period. A common phase means a mean resultant length of at least 0.8 (Mardia and
/// Jupp, Directional Statistics, 2.3). Times are in ns on the clock of the loop. No function allocates.
class PhaseLock {
 public:
  /// `period` of the loop, > 0. `margin` in 0..period/2.
  PhaseLock(Nanoseconds period, Nanoseconds margin) : period_(period), margin_(margin) {}

  /// Call it once in each step. `due`: when the step was due. `arrival`: when the newest sample arrived. Returns by how
  /// much the later steps must move; negative: earlier. For a new source at most half of the period, once. Then at most
  /// 0.5 % of the period.
  Nanoseconds follow(Nanoseconds due, Nanoseconds arrival);

  /// The source has a common phase with the loop.
  bool locked() const { return locked_; }
  /// Time from a sample to its step: nine of ten samples wait at least so long. 0 if not locked.
  Nanoseconds wait() const { return wait_; }

 private:
  static constexpr std::size_t kWindow = 32;  // samples

  Nanoseconds period_, margin_;
  Nanoseconds newest_ = 0;                    // arrival
  Nanoseconds moved_ = 0;                     // sum of all returned shifts
  std::array<Nanoseconds, kWindow> waits_{};  // at most half a period, as if the grid had never moved
  std::size_t count_ = 0;                     // of samples since the start
  bool found_ = false;                        // the grid has moved to this source
  bool locked_ = false;
  Nanoseconds wait_ = 0;
};

}  // namespace softhand
