// Interface of a tracker. A tracker is one folder under services/trackers/ with one class that implements
// TrackerSource. `run_tracker` (service/tracker_service.hpp) does everything else (docs/add-a-tracker.md).
#pragma once

#include "messages/messages.hpp"

namespace softhand {

/// Confidence of a joint for which the device delivers a pose and says that it does not see it.
inline constexpr double kGuessedConfidence = 0.5;

/// Takes the samples of a tracker.
///
/// The source sets `stamp.sample_time` to the time of the measurement, not of the delivery, on the clock of `poll`'s
/// `now`. `stamp.sequence` counts up by one for each sample of the device, delivered or not, for each hand and for the
/// head.
///
/// For a hand it fills in `hand.side`, `frame`, `confidence` and the joints. kJointValid is not set on joints that the
/// device does not see. So a wrist alone, single joints, or fingers without a wrist are hands too. The confidence of a
/// joint stays 1 unless the device knows better.
///
/// For the head it fills in `position`, `orientation` and `valid`.
///
/// `run_tracker` fills in the rest: user, source, epoch and times of publishing.
class TrackerSink {
 public:
  /// Confidence 0 says that the device sees no hand on this side. Such a sample is not published, so that a weaker
  /// tracker can take over.
  virtual void hand(const Skeleton& sample) = 0;
  virtual void head(const HeadPose& sample) = 0;

 protected:
  ~TrackerSink() = default;
};

/// What a source knows about its device.
struct SourceState {
  bool connected = true;      ///< false: no sample can arrive now (port closed, no connection)
  std::uint64_t refused = 0;  ///< packets refused since the start
};

class TrackerSource {
 public:
  virtual ~TrackerSource() = default;
  /// Passes all samples that the device has delivered by `now`, oldest first. Called at 1 kHz by the real-time loop:
  /// must not block, allocate or throw.
  virtual void poll(Nanoseconds now, TrackerSink& out) = 0;
  virtual SourceState state() const { return {}; }
  /// Adds counters of the source to the status.
  virtual void fill_status(LoopStatus&) const {}
  /// Starts a played motion over, as if it had begun at `begin`. This time is not in the future. A device cannot do
  /// this.
  virtual void restart(Nanoseconds /*begin*/) {}
};

}  // namespace softhand
