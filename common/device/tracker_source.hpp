// What a tracker implements: one folder under services/trackers/, one class of this face, one line of CMake
// (docs/add-a-tracker.md).
#pragma once

#include "messages/messages.hpp"

namespace softhand {

class TrackerSource {
 public:
  virtual ~TrackerSource() = default;
  /// The newest sample that the device has delivered by `now` and that no earlier call has returned; false, with `out`
  /// untouched, when there is none. `out.stamp.sample_time` is when the device measured (not when it delivered), on the
  /// clock of `now`; `out.stamp.sequence` counts up by one for each sample of the device, delivered or not. Joints that
  /// the device does not see carry no kJointValid. Does not block.
  virtual bool sample(Nanoseconds now, Skeleton& out) = 0;
};

}  // namespace softhand
