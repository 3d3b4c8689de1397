// One writer per key: which of several writers a reader follows.
#pragma once

#include "messages/age.hpp"

namespace softhand {

/// A writer that is silent for this time has lost its place to the next one, s.
inline constexpr double kWriterRest = 0.2;

/// Follows the first writer of a key, and another one only when the first has fallen silent. `Stamp::epoch` tells
/// writers apart.
class FollowedWriter {
 public:
  /// Returns false for a sample of a second writer. Also for a sample of a new writer that was published before the
  /// last sample of the old one, for example before a restart.
  bool accept(const Stamp& stamp, Nanoseconds now) {
    if (any_ && stamp.epoch != epoch_) {
      const bool has_rested = age_of(heard_, now).value_or(0) > kWriterRest;
      if (!has_rested || stamp.publish_time < published_) return false;
    }
    any_ = true;
    epoch_ = stamp.epoch;
    published_ = stamp.publish_time;
    heard_ = now;
    return true;
  }

 private:
  bool any_ = false;
  std::uint64_t epoch_ = 0;
  Nanoseconds published_ = 0;  // of the last accepted sample
  Nanoseconds heard_ = 0;
};

}  // namespace softhand
