// Interface of a tracker. A tracker is one folder under services/trackers/, one class that implements this interface,
// and one line of CMake (docs/add-a-tracker.md).
#pragma once

#include "messages/messages.hpp"

namespace softhand {

class TrackerSource {
 public:
  virtual ~TrackerSource() = default;
  /// Copies the newest sample that the device has delivered by `now` into `out`. If no sample is newer than the last
  /// returned one, returns false and does not change `out`. Does not block.
  /// The tracker must fill in three fields. `out.stamp.sample_time` is the time of the measurement (not of the
  /// delivery), on the clock of `now`. The value of `out.stamp.sequence` counts up by one for each sample of the
  /// device, delivered or not. The flag kJointValid is not set on joints that the device does not see.
  virtual bool sample(Nanoseconds now, Skeleton& out) = 0;
};

}  // namespace softhand
